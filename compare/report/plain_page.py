"""Pages of sentences, tables and pictures, without a script of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slamgauge.compare.report.glossary import glossary
from slamgauge.compare.report.page import render
from slamgauge.compare.report.page_elements import Cell, Picture, Table, sized
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import cell, interval_cell


def plain_page(
    *,
    kind: str,
    title: str,
    lead: Sequence[tuple[str, str]],
    tables: Sequence[Table],
    origin: Sequence[tuple[str, str, bool]],
    notes: Sequence[str] = (),
    pictures: Sequence[Picture] = (),
    terms: Sequence[tuple[str, str]] = (),
    back: str = "",
    verbatim: Sequence[str] = (),
) -> str:
    """Return the HTML of a page; each parameter is a part of the template `plain.html`.

    Args:
        kind: Kind of page, shown above the title.
        title: Title of the page.
        lead: First sentences, each with the name of its estimator.
        tables: Tables; those without rows are not shown.
        origin: Names and values of the command, version and seeds that made the results.
        notes: Further sentences.
        pictures: Pictures with captions.
        terms: Terms to explain in the glossary, in addition to the columns.
        back: Link to the page above.
        verbatim: Lines that a program printed.
    """
    return render(
        "plain.html",
        kind=kind,
        title=title,
        lead=lead,
        notes=notes,
        tables=tables,
        pictures=pictures,
        glossary=glossary(terms, tables),
        origin=origin,
        back=back,
        verbatim=verbatim,
    )


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
