// @ts-check
/** A canvas with as many pixels as the screen shows, addressed in CSS pixels. */

const MOST_DOTS = 2; // device pixels per CSS pixel; more cost time and show nothing

/**
 * Fit a canvas to its place; false where nothing of it shows.
 * @param {HTMLCanvasElement} canvas
 */
export function fit(canvas) {
  const dots = Math.min(devicePixelRatio || 1, MOST_DOTS);
  const [width, height] = [Math.round(canvas.clientWidth * dots), Math.round(canvas.clientHeight * dots)];
  if (!width || !height) return false;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  drawing(canvas).setTransform(dots, 0, 0, dots, 0, 0);
  return true;
}

/**
 * What draws on a canvas.
 * @param {HTMLCanvasElement} canvas
 * @returns {CanvasRenderingContext2D}
 */
export function drawing(canvas) {
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
}
