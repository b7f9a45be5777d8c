// @ts-check
/** The replay of a run: map, panels, time line and their controls. */

import { Camera } from "./camera.js";
import { onScheme } from "./colours.js";
import { download } from "./download.js";
import { Panel } from "./panel.js";
import { Player } from "./player.js";
import { Scene } from "./scene.js";
import { figure } from "./ticks.js";
import { Timeline } from "./timeline.js";

/**
 * A run as encoded by `replay_data.py`; frames are the shown steps, poses are rows of x, y [m] and heading [rad].
 * @typedef {{mapAt: Int32Array, start: Int32Array, landmark: Int32Array, member: Uint8Array, weight: Uint8Array,
 *   place: Float32Array, cov: Float32Array | null, since: Int32Array | null, isHistory: boolean}} Rows
 * @typedef {{name: string, color: string, dashes: number[], shown: boolean, poses: Float32Array, predicted: Float32Array,
 *   covs: Float32Array | null, error: Float32Array, nees: Float32Array, nis: Float32Array, rows: Rows | null,
 *   association: Int32Array | null, wrong: Uint8Array | null, wrongFrames: Int32Array}} Estimate
 * @typedef {{start: Int32Array, body: Float32Array, bearingOnly: boolean}} Observations
 * @typedef {{step: Int32Array, time: Float32Array, truth: {poses: Float32Array | null, landmarks: Float32Array | null},
 *   observations: Observations, estimates: Estimate[], closures: Int32Array, world: {low: [number, number], high: [number, number]},
 *   errorTitle: string, neesBand: [number, number]}} Run
 */

const SPEEDS = [0.5, 1, 2, 5, 10, 20, 50, 100];
const LENGTH = 30; // [s] approximate length of a replay at the default speed
const ROUNDING = 1e-9; // [m] smaller errors are shown as 0

/** @template {Element} T @param {string} id @returns {T} */
const element = (id) => /** @type {any} */ (document.getElementById(id));

/**
 * Start the replay of a page.
 * @param {Run} run
 */
export function startReplay(run) {
  const map = /** @type {HTMLCanvasElement} */ (element("map-canvas"));
  const scrub = /** @type {HTMLInputElement} */ (element("scrub"));
  const play = element("play"), now = element("now");
  const camera = new Camera(run.world), scene = new Scene(map, run, camera);
  let isFollowing = false;
  const player = new Player(run.time, (frame, time, isPlaying) => {
    if (isFollowing) follow(frame);
    scene.draw(frame);
    timeline.draw(frame);
    for (const panel of panels) panel.show(time);
    scrub.value = String(frame);
    play.textContent = isPlaying ? "Pause" : "Play";
    now.setAttribute("aria-live", isPlaying ? "off" : "polite");
    now.textContent = momentText(run, frame);
    scrub.setAttribute("aria-valuetext", `${figure(time)} s`);
  });
  const timeline = new Timeline(element("timeline"), run, (frame) => player.jump(frame));
  const panels = makePanels(run, (time) => player.jumpToTime(time));
  const redraw = () => player.jump(player.frame);
  const redrawAll = () => {
    for (const panel of panels) panel.draw();
    redraw();
  };
  const follow = (/** @type {number} */ frame) => {
    const poses = run.truth.poses ?? run.estimates.find((each) => each.shown)?.poses ?? run.estimates[0].poses;
    if (camera.isWhole) camera.zoom(3);
    [camera.x, camera.y] = [poses[3 * frame], poses[3 * frame + 1]];
  };
  const setFollowing = (/** @type {boolean} */ is) => {
    isFollowing = is;
    element("follow").setAttribute("aria-pressed", String(is));
    redraw();
  };
  const whole = () => {
    camera.isWhole = true;
    setFollowing(false);
  };
  const toggle = (/** @type {number} */ place) => {
    const each = run.estimates[place];
    if (!each) return;
    each.shown = !each.shown;
    document.querySelector(`.toggle[data-estimator="${place}"]`)?.setAttribute("aria-pressed", String(each.shown));
    for (const panel of panels) panel.chart.series[place].shown = each.shown;
    redrawAll();
  };

  play.addEventListener("click", () => player.toggle());
  element("back").addEventListener("click", () => player.jump(player.frame - 1));
  element("forward").addEventListener("click", () => player.jump(player.frame + 1));
  element("follow").addEventListener("click", () => setFollowing(!isFollowing));
  element("whole").addEventListener("click", whole);
  element("series-csv").addEventListener("click", () => download("series.csv", seriesRows(run)));
  scrub.max = String(run.time.length - 1);
  scrub.addEventListener("input", () => player.jump(Number(scrub.value)));
  document.querySelectorAll(".toggle").forEach((each, place) => each.addEventListener("click", () => toggle(place)));
  document.querySelectorAll(".layer").forEach((button) => {
    button.addEventListener("click", () => {
      const layer = /** @type {keyof Scene["layers"]} */ (/** @type {HTMLElement} */ (button).dataset.layer);
      scene.layers[layer] = !scene.layers[layer];
      button.setAttribute("aria-pressed", String(scene.layers[layer]));
      redraw();
    });
  });
  chooseSpeed(/** @type {any} */ (element("speed")), player);
  moveByPointer(map, camera, () => setFollowing(false), redraw);
  moveByKeys(player, { follow: () => setFollowing(!isFollowing), whole, toggle, zoom: (by) => (camera.zoom(by), redraw()) });
  new ResizeObserver(redraw).observe(map);
  onScheme(redrawAll);
  redrawAll();
  return player;
}

/**
 * @param {Run} run
 * @param {(time: number) => void} onTime
 */
function makePanels(run, onTime) {
  const chart = (/** @type {string} */ title, /** @type {"error" | "nees" | "nis"} */ key, /** @type {object} */ more) => ({
    title,
    times: run.time,
    series: run.estimates.map((each) => ({ color: each.color, dashes: each.dashes, values: each[key], shown: each.shown })),
    ...more,
  });
  const band = (/** @type {[number, number]} */ [low, high]) => ({
    low: run.time.map(() => low),
    high: run.time.map(() => high),
  });
  return [
    new Panel(element("error-panel"), chart(run.errorTitle, "error", {}), onTime),
    new Panel(
      element("nees-panel"),
      chart("pose NEES, 95 % band of a single step", "nees", { logarithmic: true, band: band(run.neesBand) }),
      onTime,
    ),
    new Panel(element("nis-panel"), chart("NIS / degrees of freedom", "nis", { logarithmic: true, level: 1 }), onTime),
  ];
}

/**
 * Time, step and errors of a frame as text.
 * @param {Run} run
 * @param {number} frame
 */
function momentText(run, frame) {
  const errors = run.estimates
    .filter((each) => each.shown && each.error[frame] === each.error[frame])
    .map((each) => `${each.name} ${figure(each.error[frame] < ROUNDING ? 0 : each.error[frame])} m`);
  return `t = ${figure(run.time[frame])} s, step ${run.step[frame]}${errors.length ? `: ${errors.join(", ")}` : ""}`;
}

/** @param {Run} run */
function seriesRows(run) {
  const head = ["step", "time_s", ...run.estimates.flatMap(({ name }) => ["x_m", "y_m", "heading_rad", "error_m", "nees", "nis_per_dof"].map((key) => `${name} ${key}`))];
  const rows = Array.from(run.time, (time, k) => [
    run.step[k],
    time,
    ...run.estimates.flatMap((each) => [...each.poses.subarray(3 * k, 3 * k + 3), each.error[k], each.nees[k], each.nis[k]]),
  ]);
  return [head, ...rows];
}

/**
 * @param {HTMLSelectElement} select
 * @param {Player} player
 */
function chooseSpeed(select, player) {
  const wanted = (player.end - player.times[0]) / LENGTH;
  player.speed = SPEEDS.find((each) => each >= wanted) ?? SPEEDS[SPEEDS.length - 1];
  for (const each of SPEEDS) select.add(new Option(`${each}\u00d7`, String(each), each === player.speed, each === player.speed));
  select.addEventListener("change", () => (player.speed = Number(select.value)));
}

/**
 * Drag to move, turn the wheel to zoom.
 * @param {HTMLCanvasElement} map
 * @param {Camera} camera
 * @param {() => void} onMove
 * @param {() => void} redraw
 */
function moveByPointer(map, camera, onMove, redraw) {
  map.addEventListener("pointerdown", (event) => map.setPointerCapture(event.pointerId));
  map.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    camera.pan(event.movementX, event.movementY);
    onMove();
  });
  map.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      camera.zoom(Math.exp(-event.deltaY / 500), event.offsetX - map.clientWidth / 2, event.offsetY - map.clientHeight / 2);
      redraw();
    },
    { passive: false },
  );
}

/**
 * @param {Player} player
 * @param {{follow: () => void, whole: () => void, toggle: (place: number) => void, zoom: (by: number) => void}} acts
 */
function moveByKeys(player, acts) {
  /** @type {Record<string, (far: boolean) => void>} */
  const keys = {
    " ": () => player.toggle(),
    ArrowLeft: (far) => player.jump(player.frame - (far ? 10 : 1)),
    ArrowRight: (far) => player.jump(player.frame + (far ? 10 : 1)),
    Home: () => player.jump(0),
    End: () => player.jump(player.times.length - 1),
    f: acts.follow,
    0: acts.whole,
    "+": () => acts.zoom(1.25),
    "-": () => acts.zoom(0.8),
  };
  document.addEventListener("keydown", (event) => {
    const at = /** @type {HTMLElement} */ (event.target);
    if (event.ctrlKey || event.altKey || event.metaKey || at.matches("select, input, .wide")) return;
    if (event.key === " " && at.matches("button, summary")) return; // the space key presses these elements
    if (/^[1-9]$/.test(event.key)) acts.toggle(Number(event.key) - 1);
    else if (event.key in keys) keys[event.key](event.shiftKey);
    else return;
    event.preventDefault();
  });
}
