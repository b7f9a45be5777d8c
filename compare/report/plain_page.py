"""Pages of sentences, tables and pictures, without a script of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slamgauge.compare.report.glossary import glossary
from slamgauge.compare.report.page import render
from slamgauge.compare.report.page_elements import Cell, Table, sized
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import cell, interval_cell

OPTIONAL: dict[str, Any] = {"notes": (), "pictures": (), "back": "", "verbatim": ()}


def plain_page(*, tables: Sequence[Table], terms: Sequence[tuple[str, str]] = (), **content: Any) -> str:
    """Return the HTML of a page.

    Args:
        tables: Tables; those without rows are not shown.
        terms: Terms to explain in the glossary, in addition to the columns.
        **content: `kind`, `title` and `origin`; `lead`, the first sentences, each with the name of its estimator;
            optionally `notes`, `pictures`, `back` (a link) and `verbatim` (lines that a program printed).
    """
    return render("plain.html", tables=tables, glossary=glossary(terms, tables), **(OPTIONAL | content))


def figure_cell(value: float | None, form: str, mark: str = "") -> Cell:
    """Return a cell that shows a number."""
    return Cell(cell(value, form) + mark, sized(value))


def interval_of(found: dict[str, Any] | None, form: str, mark: str = "") -> Cell:
    """Return a cell with a mean and its interval, from their JSON form."""
    if found is None:
        return Cell("-")
    return Cell(interval_cell(Interval(**found), form) + mark, found["mean"])


def from_to(low: float | None, high: float | None, form: str) -> str:
    """Return an interval as text."""
    return "-" if low is None and high is None else f"{cell(low, form)} to {cell(high, form)}"
