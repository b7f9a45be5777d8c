// @ts-check
/** Start the scripts of a page. */

import { startReplay } from "./replay.js";
import { sortable, tableAsCsv } from "./tables.js";
import { unpackAll } from "./unpack.js";

const data = JSON.parse(/** @type {string} */ (document.getElementById("data")?.textContent));
for (const each of document.querySelectorAll(".script")) each.removeAttribute("hidden");
for (const each of document.querySelectorAll("table.sortable")) sortable(/** @type {HTMLTableElement} */ (each));
for (const each of document.querySelectorAll("[data-csv]")) {
  const table = document.getElementById(/** @type {HTMLElement} */ (each).dataset.csv ?? "");
  each.addEventListener("click", () => tableAsCsv(/** @type {HTMLTableElement} */ (table)));
}
if (data.run) startReplay(unpackAll(data.run));
