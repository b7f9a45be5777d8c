// @ts-check
/** The shown moment: it advances while playing, or jumps. */

/** @typedef {(frame: number, time: number, isPlaying: boolean) => void} Show */

export class Player {
  /**
   * @param {ArrayLike<number>} times [s] of the frames
   * @param {Show} show draws a moment
   */
  constructor(times, show) {
    this.times = times;
    this.show = show;
    this.frame = 0;
    this.time = times[0];
    this.speed = 1;
    this.isPlaying = false;
    this.last = 0; // [ms] when the last moment was drawn
  }

  get end() {
    return this.times[this.times.length - 1];
  }

  toggle() {
    if (this.isPlaying) {
      this.isPlaying = false;
      this.#notify();
      return;
    }
    if (this.frame === this.times.length - 1) this.jump(0);
    this.isPlaying = true;
    this.last = performance.now();
    requestAnimationFrame((now) => this.#run(now));
    this.#notify();
  }

  /** @param {number} frame */
  jump(frame) {
    this.frame = Math.min(Math.max(frame, 0), this.times.length - 1);
    this.time = this.times[this.frame];
    this.#notify();
  }

  /** @param {number} time [s] */
  jumpToTime(time) {
    this.jump(frameAt(this.times, time));
  }

  /** @param {number} now [ms] */
  #run(now) {
    if (!this.isPlaying) return;
    this.time = Math.min(this.time + (this.speed * Math.max(now - this.last, 0)) / 1000, this.end);
    this.last = now;
    this.frame = frameAt(this.times, this.time);
    if (this.time >= this.end) this.isPlaying = false;
    else requestAnimationFrame((next) => this.#run(next));
    this.#notify();
  }

  #notify() {
    this.show(this.frame, this.time, this.isPlaying);
  }
}

/**
 * The last frame at or before a time.
 * @param {ArrayLike<number>} times
 * @param {number} time
 */
export function frameAt(times, time) {
  let [low, high] = [0, times.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}
