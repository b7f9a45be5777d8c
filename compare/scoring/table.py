"""Tables of results, the same for terminals, notebooks, pages and files; pages of tables and lines of text."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import zip_longest
from typing import NamedTuple

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.storage.files import write_csv
from slamgauge.display import html_table

LONGEST_NAME = 28  # characters of the first column if the width is limited; longer names lose their middle
NARROWEST = 22  # characters: least width of a column of sentences
VAST = 1e9  # figures from here on are written with an exponent, to keep columns narrow
NO_FIGURE = "-"  # text of None
MARK = "?"  # behind figures that are relative to an optimum in doubt
LATEX_NAMES = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$"}
LATEX = str.maketrans({sign: f"\\{sign}" for sign in "&%$#_{}"} | LATEX_NAMES)  # escapes


@dataclass(frozen=True)
class Head:
    """Column of a table."""

    title: str
    name: str = ""  # full name, if it differs from the title
    help: str = ""
    words: bool = False  # the cells are texts, which are aligned at the left
    wraps: bool = False  # the texts may continue on further lines
    key: str = ""  # key of a metric
    form: str = "{:.3f}"  # format of the figures
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
KIND = Head("kind", help="filtered: measurements up to the step; smoothed: all; the two are not compared", words=True)
RUNS = Head("runs", help="number of runs")


def cell(value: float | Interval | None, form: str) -> str:
    """Return a figure formatted by `form`, an interval as `mean ± half width`, `-` for None.

    A figure that is rounded to 0 has no minus.
    """
    if value is None:
        return NO_FIGURE
    if isinstance(value, Interval):
        half = "" if value.half_width is None else f" ± {cell(value.half_width, form).removeprefix('+')}"
        return f"{cell(value.mean, form)}{half}"
    text = form.format(value) if abs(value) < VAST else f"{value:.3g}"
    return form.format(0.0) if text.startswith("-") and not set(text) & set("123456789") else text


def figure(value: float | Interval | None, form: str) -> Cell:
    """Return a cell that shows a number, or a mean with its interval."""
    return Cell(cell(value, form), value)


def from_to(low: float | None, high: float | None, form: str) -> Cell:
    """Return a cell that shows an interval by its ends; its value is the lower one."""
    return Cell(NO_FIGURE if low is None and high is None else f"{cell(low, form)} to {cell(high, form)}", low)


def marked(found: Cell, is_marked: bool | None) -> Cell:
    """Return a cell with the mark of a doubt, or with a blank, to keep a column aligned; None: with neither."""
    if is_marked is None:
        return found
    return found._replace(text=found.text + (MARK if is_marked and found.text != NO_FIGURE else " " * len(MARK)))


def sized(value: float | Interval | None) -> float | None:
    """Return a number, or the mean of an interval: cells are sorted by it."""
    return value.mean if isinstance(value, Interval) else value


@dataclass(frozen=True)
class Page:
    """Tables and lines, in order."""

    parts: tuple[Table | str, ...]

    def __str__(self) -> str:
        return self.text()

    def html(self) -> str:
        """Return tables and paragraphs for a notebook."""
        return "\n".join(_html(part) for part in self.parts)

    def text(self, width: int | None = None) -> str:
        """Return lines of at most `width` characters, except for longer words; None sets no limit.

        A table has full names in its head, or else short titles, or else the last columns are hidden.
        """
        lines: list[str] = []
        for part in self.parts:
            lines += _table_lines(part, width) if isinstance(part, Table) else _wrapped(part, width)
        return "\n".join(lines)


def _html(part: Table | str) -> str:
    if isinstance(part, Table):
        return html_table([head.full for head in part.heads], part.texts()[1:])
    return f"<p>{html.escape(part)}</p>" if part else ""


def _wrapped(line: str, width: int | None) -> list[str]:
    if width is None or len(line) <= width or "\n" in line:  # a refusal of user code ends with a wrapper to copy
        return [line]
    return textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _table_lines(table: Table, width: int | None) -> list[str]:
    titles, *rows = table.texts()
    for head in ([head.full for head in table.heads], titles):
        if width is None or sum(_widths([head, *rows])) + 2 * len(head) - 2 <= width:
            return _aligned([head, *rows], table.heads)
    return _fitted_lines(table, width or 0)


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


def _aligned(rows: Sequence[Sequence[str]], heads: Sequence[Head]) -> list[str]:
    """Return rows, first the titles, as lines without trailing blanks: words are at the left, figures at the right."""
    widths = _widths(rows)
    lines: list[str] = []
    for row in rows:
        columns = zip(row, widths, heads, strict=False)
        parts = [text.ljust(width) if head.words else text.rjust(width) for text, width, head in columns]
        lines.append("  ".join(parts).rstrip())
    return lines


def _fitted_lines(table: Table, width: int) -> list[str]:
    """Return the columns that fit, sentences on several lines, and the names of the other columns that have figures."""
    rows = [[_shortened(row[0]), *row[1:]] for row in table.texts()]
    sizes = zip(_widths(rows), table.heads, strict=True)
    least = [min(NARROWEST, size) if head.wraps else size for size, head in sizes]
    kept = 1
    while kept < len(least) and sum(least[: kept + 1]) + 2 * kept <= width:
        kept += 1
    room = width - sum(least[:kept]) - 2 * (kept - 1)
    tall: list[tuple[str, ...]] = []
    for row in rows:
        columns = zip(row[:kept], least, table.heads, strict=False)
        tall += zip_longest(*(_pieces(text, head, size + room) for text, size, head in columns), fillvalue="")
    names = enumerate(table.heads[kept:], kept)
    hidden = [head.full for place, head in names if any(row[place] != NO_FIGURE for row in rows[1:])]
    note = f"Hidden columns (show with --wide): {', '.join(hidden)}"
    return _aligned(tall, table.heads) + (_wrapped(note, width) if hidden else [])


def _pieces(text: str, head: Head, room: int) -> list[str]:
    """Return a text in lines of at most `room` characters, if it may continue on further lines."""
    return textwrap.wrap(text, room, break_on_hyphens=False) or [""] if head.wraps else [text]


def _shortened(name: str) -> str:
    """Return the name, without its middle if it is long."""
    half = (LONGEST_NAME - 3) // 2
    return name if len(name) <= LONGEST_NAME else f"{name[:half]}...{name[-half:]}"


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
    head, *body = [" & ".join(text.translate(LATEX) for text in row) + r" \\" for row in table.texts()]
    lines = [
        f"% {comment}",
        r"% needs \usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{table.caption.translate(LATEX)}}}",
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
