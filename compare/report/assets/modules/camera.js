// @ts-check
/** The visible part of a map, with zoom and pan. */

const CLOSEST = 400, FARTHEST = 1e-3; // pixels per metre

export class Camera {
  /** @param {{low: [number, number], high: [number, number]}} world limits [m] of the whole map */
  constructor(world) {
    this.world = world;
    this.isWhole = true; // until the user moves the map
    this.x = 0;
    this.y = 0;
    this.scale = 1; // pixels per metre
  }

  /**
   * Show the whole map.
   * @param {number} width of the map in pixels
   * @param {number} height
   */
  whole(width, height) {
    const { low, high } = this.world;
    this.x = (low[0] + high[0]) / 2;
    this.y = (low[1] + high[1]) / 2;
    this.scale = 0.94 * Math.min(width / (high[0] - low[0] || 1), height / (high[1] - low[1] || 1));
    this.isWhole = true;
  }

  /**
   * Zoom about a fixed point of the screen.
   * @param {number} factor
   * @param {number} dx pixels right of the middle
   * @param {number} dy pixels below it
   */
  zoom(factor, dx = 0, dy = 0) {
    const scale = Math.min(Math.max(this.scale * factor, FARTHEST), CLOSEST);
    this.x += dx / this.scale - dx / scale;
    this.y -= dy / this.scale - dy / scale;
    this.scale = scale;
    this.isWhole = false;
  }

  /**
   * Move by pixels.
   * @param {number} dx
   * @param {number} dy
   */
  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
    this.isWhole = false;
  }
}
