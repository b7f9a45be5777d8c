"""Tables of results, the same for terminals, notebooks, pages and files; each of these has a writer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from slamgauge.compare.scoring.intervals import Interval

VAST = 1e9  # figures from here on are written with an exponent, to keep columns narrow
NO_FIGURE = "-"  # text of None
MARK = "?"  # behind figures that are relative to an optimum in doubt


@dataclass(frozen=True)
class Head:
    """Column of a table.

    Attributes:
        title: short name.
        name: full name, if it differs from the title.
        help: explanation.
        words: whether the cells are texts, which are aligned at the left.
        wraps: whether the texts may continue on further lines.
        key: key of the metric, if it is one.
        form: format of the figures.
    """

    title: str
    name: str = ""
    help: str = ""
    words: bool = False
    wraps: bool = False
    key: str = ""
    form: str = "{:.3f}"

    @property
    def full(self) -> str:
        """Full name."""
        return self.name or self.title


class Cell(NamedTuple):
    """Cell of a table: text, value for sorting and for files, and link."""

    text: str
    value: float | Interval | None = None
    link: str = ""


@dataclass(frozen=True)
class Table:
    """A table with the most important columns first.

    Attributes:
        heads: columns.
        rows: cells of each row.
        caption: what the table shows.
        id: name on a page.
    """

    heads: Sequence[Head]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    id: str = ""

    @classmethod
    def of(cls, heads: Sequence[Head], rows: Sequence[Sequence[Cell | str]], caption: str = "", id: str = "") -> Table:
        """Return a table whose cells may be texts."""
        cells = [[Cell(each) if isinstance(each, str) else each for each in row] for row in rows]
        return cls(heads, cells, caption, id)


ESTIMATOR = Head("estimator", help="name of the estimator", words=True)
KIND = Head(
    "kind",
    help="filtered: poses use only measurements up to their step; smoothed: they use all; the two are not compared",
    words=True,
)
RUNS = Head("runs", help="number of runs")


def cell(value: float | None, form: str) -> str:
    """Return a figure formatted by `form`, `-` for None; a figure that is rounded to 0 has no minus."""
    if value is None:
        return NO_FIGURE
    text = form.format(value) if abs(value) < VAST else f"{value:.3g}"
    return form.format(0.0) if text.startswith("-") and not set(text) & set("123456789") else text


def interval_cell(interval: Interval | None, form: str) -> str:
    """Return `mean ± half width`, or `-` for None."""
    if interval is None or interval.low is None or interval.high is None:
        return cell(None if interval is None else interval.mean, form)
    half = cell((interval.high - interval.low) / 2, form).removeprefix("+")
    return f"{cell(interval.mean, form)} ± {half}"


def figure(value: float | Interval | None, form: str) -> Cell:
    """Return a cell that shows a number, or a mean with its interval."""
    text = interval_cell(value, form) if isinstance(value, Interval) else cell(value, form)
    return Cell(text, value)


def from_to(low: float | None, high: float | None, form: str) -> Cell:
    """Return a cell that shows an interval by its ends; its value is the lower one."""
    return Cell(NO_FIGURE if low is None and high is None else f"{cell(low, form)} to {cell(high, form)}", low)


def marked(found: Cell, mark: str, *, is_marked: bool) -> Cell:
    """Return a cell with the mark, or with blanks instead, to keep the figures of a column aligned."""
    return found._replace(text=found.text + (mark if is_marked and found.text != NO_FIGURE else " " * len(mark)))


def sized(value: float | Interval | None) -> float | None:
    """Return the number by which a cell is sorted."""
    return value.mean if isinstance(value, Interval) else value
