// @ts-check
/** Downloads of data as CSV files. */

/**
 * Download rows as a CSV file.
 * @param {string} name
 * @param {(string | number)[][]} rows
 */
export function download(name, rows) {
  const text = rows.map((row) => row.map(quoted).join(",")).join("\r\n");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([`${text}\r\n`], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/**
 * A cell of a CSV file; texts that spreadsheets would read as formulas are quoted.
 * @param {string | number} value
 */
function quoted(value) {
  if (typeof value === "number") return Number.isFinite(value) ? String(value) : "";
  const text = /^[=+@\t\r]|^-./.test(value) && Number.isNaN(Number(value)) ? `'${value}` : value;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
