// @ts-check
/** A time line with marks of events; a click selects a frame. */

import { inks, shade } from "./colours.js";
import { drawing, fit } from "./surface.js";

/** @typedef {import("./replay.js").Run} Run */

export class Timeline {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Run} run
   * @param {(frame: number) => void} onFrame receives the frame at a click or drag
   */
  constructor(canvas, run, onFrame) {
    this.canvas = canvas;
    this.run = run;
    const jump = (/** @type {PointerEvent} */ event) => {
      const share = Math.min(Math.max(event.offsetX / Math.max(canvas.clientWidth, 1), 0), 1);
      onFrame(Math.round(share * (run.time.length - 1)));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      jump(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && jump(event));
  }

  /** @param {number} frame the shown frame */
  draw(frame) {
    if (!fit(this.canvas)) return;
    const { clientWidth: width, clientHeight: height } = this.canvas, pen = drawing(this.canvas), colours = inks();
    const xOf = (/** @type {number} */ k) => (k / Math.max(this.run.time.length - 1, 1)) * width;
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = colours.line;
    pen.fillRect(0, 0, xOf(frame), height);
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "top";
    pen.fillStyle = pen.strokeStyle = colours.ink;
    if (this.run.closures.length) pen.fillText("loop closures", 4, 2);
    marks(pen, this.run.closures, xOf, 15, 22);
    let y = 24;
    for (const each of this.run.estimates) {
      if (!each.shown || !each.wrongFrames.length) continue;
      pen.strokeStyle = pen.fillStyle = shade(each.color);
      marks(pen, each.wrongFrames, xOf, y, y + 7);
      if (y === 24) pen.fillText("wrong associations", 84, 2);
      y = y > 26 ? 26 : y + 5;
    }
    pen.fillStyle = colours.ink;
    pen.fillRect(xOf(frame) - 1, 0, 2, height);
  }
}

/**
 * @param {CanvasRenderingContext2D} pen
 * @param {ArrayLike<number>} frames
 * @param {(k: number) => number} xOf
 * @param {number} top
 * @param {number} bottom
 */
function marks(pen, frames, xOf, top, bottom) {
  pen.lineWidth = 1;
  pen.beginPath();
  for (let k = 0; k < frames.length; k++) {
    pen.moveTo(xOf(frames[k]), top);
    pen.lineTo(xOf(frames[k]), bottom);
  }
  pen.stroke();
}
