// @ts-check
/** A chart with a row of dots per estimator, one dot per run. */

import { inks, shade } from "./colours.js";
import { drawing, fit } from "./surface.js";
import { figure, logTicks } from "./ticks.js";

/** @typedef {{name: string, color: string, values: ArrayLike<number>, runs: ArrayLike<number>, shown: boolean}} Row */

const MARGIN = 14, BELOW = 36, NEAR = 30; // [pixels]

export class Strip {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Row[]} rows
   * @param {string} title of the axis
   * @param {(run: number) => void} onRun receives the run whose dot is nearest to a click
   */
  constructor(canvas, rows, title, onRun) {
    this.canvas = canvas;
    this.rows = rows;
    this.title = title;
    /** @type {number | null} */
    this.chosen = null;
    canvas.addEventListener("pointerdown", (event) => {
      const run = this.#nearest(event.offsetX, event.offsetY);
      if (run !== null) onRun(run);
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  get shown() {
    return this.rows.filter((row) => row.shown);
  }

  draw() {
    if (!fit(this.canvas)) return;
    const pen = drawing(this.canvas), colours = inks(), { clientWidth: width, clientHeight: height } = this.canvas;
    pen.clearRect(0, 0, width, height);
    pen.font = "12px system-ui, sans-serif";
    const { low, high } = this.#limits();
    pen.fillStyle = colours.soft;
    pen.strokeStyle = colours.line;
    pen.textAlign = "center";
    for (const tick of logTicks(low, high)) {
      const x = this.#x(tick);
      pen.beginPath();
      pen.moveTo(x, 6);
      pen.lineTo(x, height - BELOW);
      pen.stroke();
      pen.fillText(figure(tick), x, height - BELOW + 14);
    }
    pen.fillText(this.title, width / 2, height - 6);
    this.shown.forEach((row, place) => this.#row(pen, row, place, colours.ink));
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {Row} row
   * @param {number} place
   * @param {string} ink
   */
  #row(pen, row, place, ink) {
    const values = Array.from(row.values), middle = this.#y(place, -1);
    pen.fillStyle = ink;
    pen.textAlign = "left";
    pen.fillText(row.name, MARGIN, middle - this.#height / 2 + 13);
    pen.fillStyle = shade(row.color);
    values.forEach((value, k) => {
      if (!(value > 0)) return;
      pen.globalAlpha = row.runs[k] === this.chosen ? 1 : 0.55;
      pen.beginPath();
      pen.arc(this.#x(value), this.#y(place, row.runs[k]), row.runs[k] === this.chosen ? 6 : 3, 0, 2 * Math.PI);
      pen.fill();
      if (row.runs[k] !== this.chosen) return;
      pen.strokeStyle = ink;
      pen.lineWidth = 1.5;
      pen.stroke();
    });
    pen.globalAlpha = 1;
    const known = values.filter((value) => value > 0).sort((a, b) => a - b);
    if (known.length) pen.fillRect(this.#x(known[known.length >> 1]) - 1.5, middle - this.#height * 0.3, 3, this.#height * 0.6);
  }

  get #height() {
    return (this.canvas.clientHeight - BELOW) / Math.max(this.shown.length, 1);
  }

  #limits() {
    const known = this.rows.flatMap((row) => (row.shown ? Array.from(row.values) : [])).filter((value) => value > 0);
    return { low: Math.min(...known, Infinity) / 1.1, high: Math.max(...known, 0) * 1.1 };
  }

  /** @param {number} value */
  #x(value) {
    const { low, high } = this.#limits();
    return MARGIN + (Math.log(value / low) / Math.log(high / low || Math.E)) * (this.canvas.clientWidth - 2 * MARGIN);
  }

  /**
   * Height of a dot: it depends on the number of the run, as in every row; -1 is the middle of the row.
   * @param {number} place
   * @param {number} run
   */
  #y(place, run) {
    const spread = run < 0 ? 0.5 : 0.36 + 0.5 * ((run * 0.618034) % 1);
    return (place + spread) * this.#height;
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  #nearest(x, y) {
    /** @type {number | null} */
    let found = null;
    let least = NEAR;
    this.shown.forEach((row, place) => {
      Array.from(row.values).forEach((value, k) => {
        const off = value > 0 ? Math.hypot(this.#x(value) - x, this.#y(place, row.runs[k]) - y) : Infinity;
        if (off < least) [found, least] = [row.runs[k], off];
      });
    });
    return found;
  }
}
