// @ts-check
/** Tables that can be sorted and downloaded. */

import { download } from "./download.js";

/**
 * Turn the column titles of a table into buttons that sort it; cells without a number come last.
 * @param {HTMLTableElement} table
 */
export function sortable(table) {
  const heads = [...table.querySelectorAll("thead th")];
  heads.forEach((head, place) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const order = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
      heads.forEach((each) => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", order);
      sort(table, place, order === "ascending" ? 1 : -1);
    });
  });
}

/**
 * @param {HTMLTableElement} table
 * @param {number} place of the column
 * @param {1 | -1} way
 */
function sort(table, place, way) {
  const body = table.tBodies[0];
  const rows = [...body.rows].map((row) => {
    const cell = row.cells[place], value = cell.dataset.value;
    return { row, text: cell.textContent ?? "", value: value === undefined ? NaN : Number(value) };
  });
  const areNumbers = rows.some((each) => !Number.isNaN(each.value));
  rows.sort((a, b) => {
    if (!areNumbers) return way * a.text.localeCompare(b.text);
    if (Number.isNaN(a.value) || Number.isNaN(b.value)) return Number(Number.isNaN(a.value)) - Number(Number.isNaN(b.value));
    return way * (a.value - b.value);
  });
  body.append(...rows.map((each) => each.row));
}

/**
 * Download a table as CSV, with numbers that are not rounded.
 * @param {HTMLTableElement} table
 */
export function tableAsCsv(table) {
  const rows = [...table.rows].map((row) =>
    [...row.cells].map((cell) => (cell.dataset.value === undefined ? (cell.textContent ?? "") : Number(cell.dataset.value))),
  );
  download(`${table.id}.csv`, rows);
}
