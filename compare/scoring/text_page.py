"""Layout of printed results: tables and lines of text within a width."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from slamgauge.compare.scoring.text_table import NO_FIGURE, aligned
from slamgauge.display import html_table

Tone = Literal["plain", "head", "good", "bad", "faint"]
Paint = Callable[[str, Tone], str]

LONGEST_NAME = 28  # characters of the first column if the width is limited; longer names lose their middle
NARROWEST = 22  # characters: least width of a column of sentences
TONES: dict[str, Tone] = {
    "passed": "good",
    "holds": "good",
    "FAILED": "bad",
    "failed": "bad",
    "does not hold": "bad",
    "not graded": "bad",
}


def plain(text: str, _: Tone) -> str:
    """Return the text without colours."""
    return text


@dataclass(frozen=True)
class Grid:
    """A table with the most important columns first. If it is too wide, the last columns are hidden.

    Attributes:
        rows: cells; the first row is the head.
        words: how many columns from the left, or which ones, are texts; columns of figures are right-aligned.
        sentences: the column whose texts may continue on further lines.
        names: full names of columns by their titles.
    """

    rows: Sequence[Sequence[str]]
    words: int | Collection[int] = 1
    sentences: int | None = None
    names: Mapping[str, str] = field(default_factory=dict)

    def full_names(self, start: int = 0) -> list[str]:
        """Return the full names of the columns from `start` on."""
        return [self.names.get(title, title) for title in self.rows[0][start:]]


@dataclass(frozen=True)
class Page:
    """Tables and lines, in order."""

    parts: tuple[Grid | str, ...]

    def __str__(self) -> str:
        return self.text()

    def html(self) -> str:
        """Return tables and paragraphs for a notebook."""
        return "\n".join(
            html_table(part.full_names(), part.rows[1:]) if isinstance(part, Grid) else _html_line(part)
            for part in self.parts
        )

    def text(self, width: int | None = None, paint: Paint = plain) -> str:
        """Return lines of at most `width` characters, except for longer words; None sets no limit."""
        lines: list[str] = []
        for part in self.parts:
            lines += _grid_lines(part, width, paint) if isinstance(part, Grid) else _wrapped(part, width)
        return "\n".join(lines)


def _wrapped(line: str, width: int | None) -> list[str]:
    if width is None or len(line) <= width:
        return [line]
    return textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _grid_lines(grid: Grid, width: int | None, paint: Paint) -> list[str]:
    """Return the table with full names in its head, or else short titles, or else without its last columns."""
    for head in (grid.full_names(), grid.rows[0]):
        lines = aligned([head, *grid.rows[1:]], grid.words)
        if width is None or max(map(len, lines)) <= width:
            body = zip(lines[1:], grid.rows[1:], strict=True)
            return [paint(lines[0], "head"), *(_painted(line, row, paint) for line, row in body)]
    return _fitted_lines(grid, width or 0, paint)


def _painted(line: str, row: Sequence[str], paint: Paint) -> str:
    """Return a line of the table with its verdict, if it has one, in the verdict's tone."""
    for text in row:
        if text in TONES:
            before, _, after = line.rpartition(text)
            return f"{before}{paint(text, TONES[text])}{after}"
    return line


def _fitted_lines(grid: Grid, width: int, paint: Paint) -> list[str]:
    """Return the columns that fit, and below them the names of the others that have figures."""
    rows = [[_shortened(row[0]), *row[1:]] for row in grid.rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    least = list(widths)
    if grid.sentences is not None:
        least[grid.sentences] = min(NARROWEST, widths[grid.sentences])
    kept = 1
    while kept < len(widths) and sum(least[: kept + 1]) + 2 * kept <= width:
        kept += 1
    shown = [row[:kept] for row in rows]
    if grid.sentences is None or grid.sentences >= kept:
        lines = _grid_lines(Grid(shown, grid.words), None, paint)
    else:
        room = width - sum(least[:kept]) - 2 * (kept - 1) + least[grid.sentences]
        lines = _with_sentences(shown, grid.words, grid.sentences, room, paint)
    names = enumerate(grid.full_names(kept), kept)
    hidden = [name for place, name in names if any(row[place] != NO_FIGURE for row in grid.rows[1:])]
    if not hidden:
        return lines
    note = f"Hidden columns (show with --wide): {', '.join(hidden)}"
    return lines + [paint(line, "faint") for line in _wrapped(note, width)]


def _with_sentences(
    rows: list[list[str]], words: int | Collection[int], place: int, room: int, paint: Paint
) -> list[str]:
    """Return the lines of a table in which the texts of column `place` continue on further lines."""
    tall: list[list[str]] = []
    begins: list[list[str] | None] = []  # the row that begins at a line; None for a continuation
    for row in rows:
        pieces = textwrap.wrap(row[place], room, break_on_hyphens=False) or [""]
        tall.append([*row[:place], pieces[0], *row[place + 1 :]])
        tall += [["" if each != place else piece for each in range(len(row))] for piece in pieces[1:]]
        begins += [row, *(None for _ in pieces[1:])]
    lines = aligned(tall, words)
    painted = [line if row is None else _painted(line, row, paint) for line, row in zip(lines, begins, strict=True)]
    return [paint(painted[0].rstrip(), "head"), *(line.rstrip() for line in painted[1:])]


def _shortened(name: str) -> str:
    """Return the name, without its middle if it is long."""
    if len(name) <= LONGEST_NAME:
        return name
    half = (LONGEST_NAME - 3) // 2
    return f"{name[:half]}...{name[-half:]}"


def _html_line(line: str) -> str:
    return f"<p>{html.escape(line)}</p>" if line else ""
