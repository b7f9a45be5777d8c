"""Tables of results, the same for terminals, notebooks, pages and files; here with the writers for files."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import NamedTuple

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.storage.files import write_csv

VAST = 1e9  # figures from here on are written with an exponent, to keep columns narrow
NO_FIGURE = "-"  # text of None
MARK = "?"  # behind figures that are relative to an optimum in doubt
LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$"} | {
    sign: f"\\{sign}" for sign in "&%$#_{}"
}


@dataclass(frozen=True)
class Head:
    """Column of a table."""

    title: str
    name: str = ""  # full name, if it differs from the title
    help: str = ""
    words: bool = False  # the cells are texts, which are aligned at the left
    wraps: bool = False  # the texts may continue on further lines
    key: str = ""  # of a metric
    form: str = "{:.3f}"  # of the figures
    relative: bool = False  # figures are relative to an optimum, and marked if that is in doubt

    @property
    def full(self) -> str:
        """Full name."""
        return self.name or self.title


class Cell(NamedTuple):
    """Cell of a table."""

    text: str
    value: float | Interval | None = None  # for sorting and for files
    link: str = ""


@dataclass(frozen=True)
class Table:
    """A table with the most important columns first."""

    heads: Sequence[Head]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    id: str = ""  # name on a page

    @classmethod
    def of(cls, heads: Sequence[Head], rows: Sequence[Sequence[Cell | str]], caption: str = "", id: str = "") -> Table:
        """Return a table whose cells may be texts."""
        cells = [[Cell(each) if isinstance(each, str) else each for each in row] for row in rows]
        return cls(heads, cells, caption, id)

    def texts(self) -> list[list[str]]:
        """Return the texts of all rows, first the titles."""
        return [[head.title for head in self.heads], *([cell.text for cell in row] for row in self.rows)]


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
    if interval is None or interval.half_width is None:
        return cell(None if interval is None else interval.mean, form)
    return f"{cell(interval.mean, form)} ± {cell(interval.half_width, form).removeprefix('+')}"


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


# --- files ---------------------------------------------------------------------------------------


def csv_text(table: Table, *, intervals: bool) -> str:
    """Return full precision; columns of metrics are KEY and, with intervals, KEY_low and KEY_high."""
    ends = {"mean": "", "low": "_low", "high": "_high"} if intervals else {"mean": ""}
    names = [[f"{head.key}{end}" for end in ends.values()] if head.key else [head.title] for head in table.heads]
    rows: list[list[object]] = [[name for found in names for name in found]]
    for row in table.rows:
        cells: list[object] = []
        for head, each in zip(table.heads, row, strict=True):
            text = each.text if each.value is None else each.value
            cells += [getattr(each.value, end, None) for end in ends] if head.key else [text]
        rows.append(cells)
    out = StringIO()
    write_csv(out, rows)
    return out.getvalue()


def markdown_text(table: Table) -> str:
    """Return a table of Markdown."""
    head, *body = [[html.escape(text, quote=False).replace("|", r"\|") for text in row] for row in table.texts()]
    rule = ["---" if each.words else "---:" for each in table.heads]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *body)) + "\n"


def latex_text(table: Table, label: str, comment: str) -> str:
    """Return a floating table with the caption of `table`; `comment` is a line on top."""
    head, *body = [" & ".join(map(escaped, row)) + r" \\" for row in table.texts()]
    lines = [
        f"% {comment}",
        r"% needs \usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{escaped(table.caption)}}}",
        rf"  \label{{tab:{label}}}",
        rf"  \begin{{tabular}}{{{''.join('l' if each.words else 'r' for each in table.heads)}}}",
        r"    \toprule",
        f"    {head}",
        r"    \midrule",
        *(f"    {row}" for row in body),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Escape a text for LaTeX."""
    return "".join(LATEX.get(sign, sign) for sign in text)
