// @ts-check
/** The charts of a study: consistency against time, errors over runs. */

import { onScheme } from "./colours.js";
import { Panel } from "./panel.js";
import { frameAt } from "./player.js";
import { Strip } from "./strip.js";
import { figure } from "./ticks.js";

/**
 * @typedef {{values: Float32Array[], low: Float32Array, high: Float32Array}} Curves
 * @typedef {{time: Float32Array, looks: {name: string, color: string, dashes: number[]}[], nees: Curves, nis: Curves,
 *   ates: Float32Array[], runs: Int32Array[], commands: string[]}} Study
 */

/** @template {Element} T @param {string} id @returns {T} */
const part = (id) => /** @type {any} */ (document.getElementById(id));

/**
 * Start the charts of a page.
 * @param {Study} study
 */
export function startStudy(study) {
  const shown = study.looks.map(() => true);
  const panels = [
    new Panel(part("study-nees"), curves(study, study.nees, "mean pose NEES (3 when consistent)"), (time) => showTime(time)),
    new Panel(part("study-nis"), curves(study, study.nis, "NIS / degrees of freedom (1 when right)"), (time) => showTime(time)),
  ];
  const rows = study.looks.map(({ name, color }, k) => ({ name, color, values: study.ates[k], runs: study.runs[k], shown: true }));
  const canvas = /** @type {HTMLCanvasElement} */ (part("study-errors"));
  const strip = new Strip(canvas, rows, "ATE [m]", (run) => choose(run));
  canvas.style.height = `${Math.max(6, 3.4 * rows.length + 2.5)}rem`;

  const showTime = (/** @type {number} */ time) => {
    const k = frameAt(study.time, time);
    for (const panel of panels) panel.show(study.time[k]);
    const figures = study.looks.filter((_, at) => shown[at]).map(({ name }) => {
      const value = study.nees.values[study.looks.findIndex((each) => each.name === name)][k];
      return `${name} ${figure(value)}`;
    });
    part("nees-now").textContent = `t = ${figure(study.time[k])} s, NEES: ${figures.join(", ")}`;
  };
  const choose = (/** @type {number} */ run) => {
    strip.chosen = run;
    strip.draw();
    const figures = rows.map((row) => `${row.name} ${figure(row.values[Array.from(row.runs).indexOf(run)])} m`);
    part("run-now").textContent = `run ${run}: ${figures.join(", ")}`;
    part("run-command").textContent = study.commands[run];
    part("run-command").removeAttribute("hidden");
  };
  const redraw = () => {
    for (const panel of panels) panel.draw();
    strip.draw();
  };
  document.querySelectorAll(".toggle").forEach((button, k) => {
    button.addEventListener("click", () => {
      shown[k] = !shown[k];
      button.setAttribute("aria-pressed", String(shown[k]));
      for (const panel of panels) panel.chart.series[k].shown = shown[k];
      rows[k].shown = shown[k];
      redraw();
    });
  });
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by === undefined || !study.commands.length) return;
    const count = study.commands.length;
    choose(((strip.chosen ?? (by > 0 ? -1 : 0)) + by + count) % count);
    event.preventDefault();
  });
  onScheme(redraw);
  redraw();
}

/**
 * @param {Study} study
 * @param {Curves} found
 * @param {string} title
 */
function curves(study, found, title) {
  const series = study.looks.map(({ color, dashes }, k) => ({ color, dashes, values: found.values[k], shown: true }));
  return { title, times: study.time, series, logarithmic: true, band: { low: found.low, high: found.high } };
}
