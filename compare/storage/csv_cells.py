"""Cells of CSV files: a text that a spreadsheet would evaluate as a formula has an apostrophe in front."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

from slamgauge.compare.storage.files import explained

FORMULA = ("=", "+", "-", "@", "\t", "\r")  # first characters of formulas in spreadsheets


def write_csv(file: TextIO, rows: Iterable[Iterable[object]]) -> None:
    """Write rows to a text file that was opened with `newline=""`; texts are quoted (`_quoted`)."""
    csv.writer(file, lineterminator="\n").writerows([_quoted(cell) for cell in row] for row in rows)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read rows below a header that `write_csv` wrote; the texts are those before quoting.

    Raises:
        UserError: the file cannot be read.
    """
    with explained(path, "read"), path.open(encoding="utf-8", newline="") as file:
        return [{key: _unquoted(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _quoted(cell: object) -> object:
    """Put an apostrophe in front of a text that begins like a formula and is not a number."""
    return f"'{cell}" if isinstance(cell, str) and _is_formula(cell) and not is_numeric_text(cell) else cell


def _unquoted(text: str) -> str:
    return text[1:] if text.startswith("'") and _is_formula(text) else text


def _is_formula(text: str) -> bool:
    """Return whether a text begins like a formula, with or without apostrophes in front."""
    return text.lstrip("'").startswith(FORMULA)


def is_numeric_text(text: str) -> bool:
    """Return whether Python reads a text as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
