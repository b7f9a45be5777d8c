// @ts-check
/** A chart of several series against time, with a cursor; a click selects a time. */

import { inks, shade } from "./colours.js";
import { drawing, fit } from "./surface.js";
import { figure, linearTicks, logTicks } from "./ticks.js";

/**
 * @typedef {{color: string, dashes: number[], values: ArrayLike<number>, shown: boolean}} Series
 * @typedef {{title: string, times: ArrayLike<number>, series: Series[], logarithmic?: boolean,
 *   band?: {low: ArrayLike<number>, high: ArrayLike<number>} | null, level?: number | null}} Chart
 */

const LEFT = 46, RIGHT = 8, TOP = 20, BOTTOM = 20;
const UNDER = 5e-3, OVER = 1e6; // limits of a logarithmic axis, relative to the median of the values

export class Panel {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Chart} chart
   * @param {(time: number) => void} onTime receives the time at a click or drag
   */
  constructor(canvas, chart, onTime) {
    this.canvas = canvas;
    this.chart = chart;
    this.ground = document.createElement("canvas"); // the static part of the chart
    this.cursor = chart.times[0];
    const jump = (/** @type {PointerEvent} */ event) => onTime(this.timeAt(event.offsetX));
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      jump(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && jump(event));
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** @param {number} x [pixels] */
  timeAt(x) {
    const { times } = this.chart;
    const [first, last] = [times[0], times[times.length - 1]];
    const share = (x - LEFT) / Math.max(this.canvas.clientWidth - LEFT - RIGHT, 1);
    return first + Math.min(Math.max(share, 0), 1) * (last - first);
  }

  /** Draw everything, after a change of size, colours or visible series. */
  draw() {
    if (!fit(this.canvas)) return;
    this.ground.width = this.canvas.width;
    this.ground.height = this.canvas.height;
    const pen = drawing(this.ground);
    pen.setTransform(drawing(this.canvas).getTransform());
    this.#layOut(pen);
    this.show(this.cursor);
  }

  /** @param {number} time new position of the cursor */
  show(time) {
    this.cursor = time;
    if (!this.ground.width) return;
    const pen = drawing(this.canvas), { clientWidth: width, clientHeight: height } = this.canvas;
    pen.clearRect(0, 0, width, height);
    pen.drawImage(this.ground, 0, 0, width, height);
    const { times } = this.chart, [first, last] = [times[0], times[times.length - 1]];
    const x = LEFT + ((time - first) / (last - first || 1)) * (width - LEFT - RIGHT);
    pen.strokeStyle = inks().ink;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x, TOP);
    pen.lineTo(x, height - BOTTOM);
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen */
  #layOut(pen) {
    const { chart } = this, { clientWidth: width, clientHeight: height } = this.canvas, colours = inks();
    const [low, high] = this.#limits();
    const scale = chart.logarithmic ? Math.log10 : (/** @type {number} */ v) => v;
    const [bottom, top] = [scale(low), scale(high)];
    const [first, last] = [chart.times[0], chart.times[chart.times.length - 1]];
    const xOf = (/** @type {number} */ t) => LEFT + ((t - first) / (last - first || 1)) * (width - LEFT - RIGHT);
    const yOf = (/** @type {number} */ v) => {
      const share = (scale(chart.logarithmic ? Math.max(v, low / 10) : v) - bottom) / (top - bottom || 1);
      return height - BOTTOM - Math.min(Math.max(share, -0.2), 1.2) * (height - TOP - BOTTOM);
    };
    pen.font = "12px system-ui, sans-serif";
    this.#axes(pen, colours, [low, high], [first, last], xOf, yOf);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
    pen.clip();
    if (chart.band) this.#band(pen, colours.soft, xOf, yOf);
    if (chart.level != null) {
      pen.strokeStyle = colours.soft;
      pen.setLineDash([2, 3]);
      line(pen, [first, last], [chart.level, chart.level], xOf, yOf);
    }
    for (const each of chart.series) {
      if (!each.shown) continue;
      pen.strokeStyle = shade(each.color);
      pen.lineWidth = 1.4;
      pen.setLineDash(each.dashes.map((length) => 1.4 * length));
      line(pen, chart.times, each.values, xOf, yOf);
    }
    pen.restore();
  }

  /** @returns {[number, number]} lowest and highest value of the axis */
  #limits() {
    const { chart } = this, values = [];
    for (const each of chart.series) if (each.shown) values.push(...Array.from(each.values).filter(Number.isFinite));
    if (chart.level != null) values.push(chart.level);
    if (chart.band) {
      for (const side of [chart.band.low, chart.band.high]) values.push(...Array.from(side).filter(Number.isFinite));
    }
    if (!chart.logarithmic) {
      const highest = values.reduce((a, b) => Math.max(a, b), 0);
      return [0, highest * 1.05 || 1];
    }
    const positive = values.filter((each) => each > 0).sort((a, b) => a - b);
    if (!positive.length) return [0.1, 10];
    const middle = positive[positive.length >> 1];
    const low = Math.max(positive[Math.floor(positive.length * 0.01)], middle * UNDER);
    const high = Math.min(positive[positive.length - 1], middle * OVER);
    return [low / 1.2, Math.max(high, low * 2) * 1.2];
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {ReturnType<typeof inks>} colours
   * @param {[number, number]} values
   * @param {[number, number]} times
   * @param {(t: number) => number} xOf
   * @param {(v: number) => number} yOf
   */
  #axes(pen, colours, [low, high], [first, last], xOf, yOf) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    pen.fillStyle = colours.soft;
    pen.strokeStyle = colours.line;
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const count = Math.max(2, Math.round((height - TOP - BOTTOM) / 32));
    for (const tick of this.chart.logarithmic ? logTicks(low, high) : linearTicks(low, high, count)) {
      line(pen, [first, last], [tick, tick], xOf, yOf);
      pen.fillText(figure(tick), LEFT - 6, yOf(tick));
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const ticks = linearTicks(first, last, Math.max(2, Math.floor(width / 90)));
    for (const tick of ticks) {
      const mark = `${figure(tick)}${tick === ticks[ticks.length - 1] ? " s" : ""}`;
      pen.fillText(mark, Math.min(xOf(tick), width - RIGHT - pen.measureText(mark).width / 2), height - BOTTOM + 4);
    }
    pen.fillStyle = colours.ink;
    pen.textAlign = "left";
    pen.textBaseline = "alphabetic";
    pen.fillText(this.chart.title, LEFT, TOP - 7);
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {string} color
   * @param {(t: number) => number} xOf
   * @param {(v: number) => number} yOf
   */
  #band(pen, color, xOf, yOf) {
    const { times, band } = this.chart;
    if (!band) return;
    pen.fillStyle = color;
    pen.globalAlpha = 0.22;
    pen.beginPath();
    for (let k = 0; k < times.length; k++) if (band.low[k] === band.low[k]) pen.lineTo(xOf(times[k]), yOf(band.low[k]));
    for (let k = times.length - 1; k >= 0; k--) if (band.high[k] === band.high[k]) pen.lineTo(xOf(times[k]), yOf(band.high[k]));
    pen.fill();
    pen.globalAlpha = 1;
  }
}

/**
 * Draw a line through points with gaps at NaN.
 * @param {CanvasRenderingContext2D} pen
 * @param {ArrayLike<number>} times
 * @param {ArrayLike<number>} values
 * @param {(t: number) => number} xOf
 * @param {(v: number) => number} yOf
 */
function line(pen, times, values, xOf, yOf) {
  pen.beginPath();
  let isDown = false;
  for (let k = 0; k < times.length; k++) {
    const value = values[k];
    if (value !== value) {
      isDown = false;
    } else if (isDown) {
      pen.lineTo(xOf(times[k]), yOf(value));
    } else {
      pen.moveTo(xOf(times[k]), yOf(value));
      isDown = true;
    }
  }
  pen.stroke();
}
