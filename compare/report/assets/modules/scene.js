// @ts-check
/** The map of a run at a moment. */

import { inks, shade } from "./colours.js";
import { drawing, fit } from "./surface.js";

/**
 * @typedef {import("./replay.js").Run} Run
 * @typedef {import("./replay.js").Estimate} Estimate
 * @typedef {import("./camera.js").Camera} Camera
 * @typedef {{x: (x: number) => number, y: (y: number) => number, scale: number}} Screen
 */

const SIGMAS = 3, ROBOT = 9; // [pixels] from the centre of the robot to its front
const FAINT = 0.45; // opacity of a final map, which has no history

export class Scene {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Run} run
   * @param {Camera} camera
   */
  constructor(canvas, run, camera) {
    this.canvas = canvas;
    this.run = run;
    this.camera = camera;
    this.layers = { observations: true, innovations: true, ellipses: true };
  }

  /** @param {number} frame */
  draw(frame) {
    if (!fit(this.canvas)) return;
    const { clientWidth: width, clientHeight: height } = this.canvas, { camera, run } = this, colours = inks();
    if (camera.isWhole) camera.whole(width, height);
    const pen = drawing(this.canvas);
    pen.clearRect(0, 0, width, height);
    /** @type {Screen} */
    const screen = {
      x: (x) => width / 2 + (x - camera.x) * camera.scale,
      y: (y) => height / 2 - (y - camera.y) * camera.scale,
      scale: camera.scale,
    };
    if (this.layers.observations) this.#observations(pen, screen, frame, colours.soft);
    this.#trueLandmarks(pen, screen, colours.ink);
    if (run.truth.poses) path(pen, screen, run.truth.poses, frame, colours.ink, 1.2);
    for (const each of run.estimates) if (each.shown) this.#estimate(pen, screen, each, frame);
    if (run.truth.poses) robot(pen, screen, run.truth.poses, frame, colours.ink, false);
    this.#scale(pen, height, colours.soft);
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {Screen} screen
   * @param {Estimate} estimate
   * @param {number} frame
   */
  #estimate(pen, screen, estimate, frame) {
    const color = shade(estimate.color), { poses, covs } = estimate;
    path(pen, screen, poses, frame, color, 1.5);
    this.#map(pen, screen, estimate, frame, color);
    if (this.layers.innovations) this.#innovations(pen, screen, estimate, frame, color);
    if (covs && this.layers.ellipses) {
      pen.strokeStyle = color;
      pen.lineWidth = 1.6;
      ellipse(pen, screen, poses[3 * frame], poses[3 * frame + 1], covs.subarray(3 * frame, 3 * frame + 3));
    }
    robot(pen, screen, poses, frame, color, true);
  }

  /**
   * Draw landmarks with their ellipses; members of rays are darker if they are more likely.
   * @param {CanvasRenderingContext2D} pen
   * @param {Screen} screen
   * @param {Estimate} estimate
   * @param {number} frame
   * @param {string} color
   */
  #map(pen, screen, estimate, frame, color) {
    const { rows } = estimate;
    if (!rows) return;
    const [first, last] = rowsAt(estimate, frame);
    pen.strokeStyle = pen.fillStyle = color;
    pen.lineWidth = 1;
    for (let row = first; row < last; row++) {
      if (rows.since && rows.since[row] > frame) continue;
      const [x, y] = [rows.place[2 * row], rows.place[2 * row + 1]];
      const isMember = rows.member[row] > 0;
      pen.globalAlpha = (rows.isHistory ? 1 : FAINT) * (isMember ? 0.2 + 0.8 * (rows.weight[row] / 255) : 1);
      if (!isMember) pen.fillRect(screen.x(x) - 1.5, screen.y(y) - 1.5, 3, 3);
      if (rows.cov && (this.layers.ellipses || isMember)) ellipse(pen, screen, x, y, rows.cov.subarray(3 * row, 3 * row + 3));
    }
    pen.globalAlpha = 1;
  }

  /**
   * Draw a line from the robot (the true one, if known) along each observation of the moment.
   * @param {CanvasRenderingContext2D} pen
   * @param {Screen} screen
   * @param {number} frame
   * @param {string} color
   */
  #observations(pen, screen, frame, color) {
    const { observations, truth, estimates } = this.run;
    const from = truth.poses ?? estimates.find((each) => each.shown)?.poses;
    if (!from) return;
    pen.strokeStyle = color;
    pen.globalAlpha = 0.5;
    pen.lineWidth = 0.8;
    pen.beginPath();
    for (let k = observations.start[frame]; k < observations.start[frame + 1]; k++) {
      const [x, y] = toWorld(from, frame, observations.body, k);
      pen.moveTo(screen.x(from[3 * frame]), screen.y(from[3 * frame + 1]));
      pen.lineTo(screen.x(x), screen.y(y));
    }
    pen.stroke();
    pen.globalAlpha = 1;
  }

  /**
   * Draw innovations: from the mapped landmark to its observed position, seen from the predicted pose; none for bearings.
   * @param {CanvasRenderingContext2D} pen
   * @param {Screen} screen
   * @param {Estimate} estimate
   * @param {number} frame
   * @param {string} color
   */
  #innovations(pen, screen, estimate, frame, color) {
    const { observations } = this.run, { rows, association, predicted, wrong } = estimate;
    if (!rows || !association || observations.bearingOnly) return;
    const [first, last] = rowsAt(estimate, Math.max(frame - 1, 0));
    pen.lineWidth = 2.2;
    for (let k = observations.start[frame]; k < observations.start[frame + 1]; k++) {
      let row = first;
      while (row < last && rows.landmark[row] !== association[k]) row++;
      if (association[k] < 0 || row === last) continue;
      const [x, y] = toWorld(predicted, frame, observations.body, k);
      pen.strokeStyle = wrong && wrong[k] ? inks().mark : color;
      pen.beginPath();
      pen.moveTo(screen.x(rows.place[2 * row]), screen.y(rows.place[2 * row + 1]));
      pen.lineTo(screen.x(x), screen.y(y));
      pen.stroke();
    }
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {Screen} screen
   * @param {string} color
   */
  #trueLandmarks(pen, screen, color) {
    const { landmarks } = this.run.truth;
    if (!landmarks) return;
    pen.strokeStyle = color;
    pen.lineWidth = 1.1;
    pen.beginPath();
    for (let k = 0; k < landmarks.length; k += 2) {
      const [x, y] = [screen.x(landmarks[k]), screen.y(landmarks[k + 1])];
      pen.moveTo(x - 4, y);
      pen.lineTo(x + 4, y);
      pen.moveTo(x, y - 4);
      pen.lineTo(x, y + 4);
    }
    pen.stroke();
  }

  /**
   * Draw a scale bar.
   * @param {CanvasRenderingContext2D} pen
   * @param {number} height
   * @param {string} color
   */
  #scale(pen, height, color) {
    const power = 10 ** Math.floor(Math.log10(110 / this.camera.scale));
    const metres = [5, 2, 1].map((each) => each * power).find((each) => each * this.camera.scale <= 110) ?? power;
    pen.strokeStyle = pen.fillStyle = color;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(14, height - 14);
    pen.lineTo(14 + metres * this.camera.scale, height - 14);
    pen.stroke();
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(`${Number(metres.toPrecision(1))} m`, 14, height - 20);
  }
}

/**
 * First and last row of the latest map at a frame.
 * @param {Estimate} estimate
 * @param {number} frame
 * @returns {[number, number]}
 */
function rowsAt({ rows }, frame) {
  if (!rows) return [0, 0];
  const map = rows.mapAt[frame];
  return map < 0 ? [0, 0] : [rows.start[map], rows.start[map + 1]];
}

/**
 * An observed position in the world frame.
 * @param {Float32Array} poses
 * @param {number} frame
 * @param {Float32Array} body positions in the body frame [m], forward and left
 * @param {number} k
 */
function toWorld(poses, frame, body, k) {
  const [x, y, heading] = poses.subarray(3 * frame, 3 * frame + 3);
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return [x + c * body[2 * k] - s * body[2 * k + 1], y + s * body[2 * k] + c * body[2 * k + 1]];
}

/**
 * @param {CanvasRenderingContext2D} pen
 * @param {Screen} screen
 * @param {Float32Array} poses
 * @param {number} frame
 * @param {string} color
 * @param {number} width
 */
function path(pen, screen, poses, frame, color, width) {
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.beginPath();
  for (let k = 0; k <= frame; k++) pen.lineTo(screen.x(poses[3 * k]), screen.y(poses[3 * k + 1]));
  pen.stroke();
}

/**
 * @param {CanvasRenderingContext2D} pen
 * @param {Screen} screen
 * @param {Float32Array} poses
 * @param {number} frame
 * @param {string} color
 * @param {boolean} filled
 */
function robot(pen, screen, poses, frame, color, filled) {
  const [x, y, heading] = poses.subarray(3 * frame, 3 * frame + 3);
  if (x !== x) return;
  pen.save();
  pen.translate(screen.x(x), screen.y(y));
  pen.rotate(-heading);
  pen.beginPath();
  for (const [forward, left] of [[1, 0], [-0.7, 0.65], [-0.35, 0], [-0.7, -0.65]]) pen.lineTo(ROBOT * forward, ROBOT * left);
  pen.closePath();
  pen.lineWidth = 1.5;
  pen.strokeStyle = pen.fillStyle = color;
  if (filled) pen.fill();
  else pen.stroke();
  pen.restore();
}

/**
 * Draw the 3-sigma ellipse of a position.
 * @param {CanvasRenderingContext2D} pen
 * @param {Screen} screen
 * @param {number} x
 * @param {number} y
 * @param {ArrayLike<number>} cov xx, xy, yy [m^2]
 */
function ellipse(pen, screen, x, y, cov) {
  const [xx, xy, yy] = [cov[0], cov[1], cov[2]];
  const middle = (xx + yy) / 2, half = Math.hypot((xx - yy) / 2, xy);
  const long = SIGMAS * Math.sqrt(Math.max(middle + half, 0)), short = SIGMAS * Math.sqrt(Math.max(middle - half, 0));
  const angle = 0.5 * Math.atan2(2 * xy, xx - yy);
  if (!(long * screen.scale < 1e5)) return; // wider than any screen, or NaN
  pen.beginPath();
  pen.ellipse(screen.x(x), screen.y(y), long * screen.scale, short * screen.scale, -angle, 0, 2 * Math.PI);
  pen.stroke();
}
