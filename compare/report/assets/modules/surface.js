// @ts-check
/** Canvases with the resolution of the screen, addressed in CSS pixels. */

const MOST_DOTS = 2; // device pixels per CSS pixel; more are slow and not visible

/**
 * Fit a canvas to its size on the page; return false if it is not visible.
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
 * The drawing context of a canvas.
 * @param {HTMLCanvasElement} canvas
 * @returns {CanvasRenderingContext2D}
 */
export function drawing(canvas) {
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
}
