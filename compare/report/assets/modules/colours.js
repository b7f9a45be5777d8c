// @ts-check
/** Colours of canvases in the light or dark scheme of the browser. */

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** Whether the browser uses its dark scheme. */
export function isDark() {
  return DARK.matches;
}

/**
 * Call `redraw` when the scheme changes.
 * @param {() => void} redraw
 */
export function onScheme(redraw) {
  DARK.addEventListener("change", redraw);
}

/**
 * Colour of an estimator as in the figures; mixed with white on dark background.
 * @param {string} hex `#rrggbb`
 */
export function shade(hex) {
  if (!isDark()) return hex;
  const mixed = [1, 3, 5].map((at) => Math.round(parseInt(hex.slice(at, at + 2), 16) * 0.55 + 255 * 0.45));
  return `#${mixed.map((each) => each.toString(16).padStart(2, "0")).join("")}`;
}

/** The current colours of text, lines, background and marks in the style sheet. */
export function inks() {
  const style = getComputedStyle(document.documentElement);
  const read = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  return { ink: read("--ink"), soft: read("--soft"), line: read("--line"), paper: read("--paper"), mark: read("--mark") };
}
