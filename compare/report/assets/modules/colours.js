// @ts-check
/** Colours of a canvas, which follow the reader's light or dark scheme. */

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** What is shown now; `print` is always light. */
export function isDark() {
  return DARK.matches;
}

/**
 * Call back when the reader changes the scheme.
 * @param {() => void} redraw
 */
export function onScheme(redraw) {
  DARK.addEventListener("change", redraw);
}

/**
 * An estimator's colour: that of the figures, on dark ground mixed with white so that it stands out as much.
 * @param {string} hex `#rrggbb`
 */
export function shade(hex) {
  if (!isDark()) return hex;
  const mixed = [1, 3, 5].map((at) => Math.round(parseInt(hex.slice(at, at + 2), 16) * 0.55 + 255 * 0.45));
  return `#${mixed.map((each) => each.toString(16).padStart(2, "0")).join("")}`;
}

/** Ink, soft ink and lines of the page, as the style sheet has them now. */
export function inks() {
  const style = getComputedStyle(document.documentElement);
  const read = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  return { ink: read("--ink"), soft: read("--soft"), line: read("--line"), paper: read("--paper"), mark: read("--mark") };
}
