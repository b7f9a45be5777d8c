"""Tables of pages: columns with their explanations, and cells."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from slamgauge.compare.scoring.catalogue import CATALOGUE, FULL_NAMES, columns
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.metric import Table as TableName
from slamgauge.compare.scoring.text_table import cell, interval_cell


class Head(NamedTuple):
    """Column of a table: title, explanation, and whether its cells are texts."""

    title: str
    help: str = ""
    words: bool = False


class Cell(NamedTuple):
    """Cell of a table: text, value for sorting, and link."""

    text: str
    value: float | None = None
    link: str = ""


@dataclass(frozen=True)
class Table:
    """Sortable table; the first cell of a row is its header."""

    id: str
    caption: str
    columns: Sequence[Head]
    rows: Sequence[Sequence[Cell]]


HELP = {each.key: each.help for each in CATALOGUE}
ESTIMATOR = Head("estimator", "name of the estimator", words=True)
KIND = Head(
    "kind",
    "filtered: poses use only measurements up to their step; smoothed: they use all; the two are not compared",
    words=True,
)
TERMS = {
    "run": (
        ("causal optimum", "best estimate from the measurements up to each step, with the true noise (causal)"),
        ("hindsight optimum", "best estimate from all measurements (batch)"),
        (
            "3-sigma ellipse",
            "region that contains the true position with probability 98.9 % if the covariance is right",
        ),
    ),
    "study": (
        ("\u00b1", "half the width of the 95 % interval of the mean over runs"),
        ("band", "interval of the mean for consistent estimates, at the stated level"),
    ),
}


def figure_heads(table: TableName, *, bounded: bool = False) -> list[Head]:
    """Return the metric columns of a table; with the columns of bounds if `bounded`."""
    return [Head(FULL_NAMES[title], HELP[key]) for title, key, _ in columns(table, bounded=bounded)]


def glossary(terms: Iterable[tuple[str, str]], tables: Iterable[Table]) -> list[tuple[str, str]]:
    """Return terms and columns of tables with rows, each once."""
    shown = [head for table in tables if table.rows for head in table.columns]
    return [*dict.fromkeys([*terms, *((head.title, head.help) for head in shown if head.help)])]


def figure_cell(value: float | None, form: str, mark: str = "") -> Cell:
    """Return a cell that shows a number."""
    return Cell(cell(value, form) + mark, sized(value))


def interval_of(found: dict[str, Any] | None, form: str, mark: str = "") -> Cell:
    """Return a cell with a mean and its interval, from their JSON form."""
    return Cell(interval_cell(Interval(**found), form) + mark, found["mean"]) if found else Cell("-")


def from_to(low: float | None, high: float | None, form: str) -> Cell:
    """Return a cell that shows an interval."""
    text = "-" if low is None and high is None else f"{cell(low, form)} to {cell(high, form)}"
    return Cell(text, low)


def sized(value: object) -> float | None:
    """Return a number for sorting, or None."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
