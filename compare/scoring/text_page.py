"""What a command prints: tables with their key columns first, and lines, laid out for a width."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from slamgauge.compare.scoring.text_table import aligned
from slamgauge.display import html_table

Tone = Literal["plain", "head", "good", "bad", "faint"]
Paint = Callable[[str, Tone], str]

LONGEST_NAME = 28  # of the first column where the width is limited; more is cut in the middle
ROOMY = 200  # characters: from here on what finds no room stands in a table of its own below, and nothing is left out
NARROWEST = 22  # a column of sentences is not made narrower than this
TONES: dict[str, Tone] = {
    **dict.fromkeys(("passed", "holds"), "good"),
    **dict.fromkeys(("FAILED", "failed", "does not hold", "not graded"), "bad"),
}


def plain(text: str, _: Tone) -> str:
    """No colours."""
    return text


@dataclass(frozen=True)
class Grid:
    """A table whose columns are in the order of their worth: where there is no room those from the right give way.

    Attributes:
        rows: cells, the head first.
        words: how many columns from the left, or which ones, are texts; figures stand to the right.
        sentences: the column whose texts may go on in further lines, if there is one.
    """

    rows: Sequence[Sequence[str]]
    words: int | Collection[int] = 1
    sentences: int | None = None


@dataclass(frozen=True)
class Page:
    """Tables and lines, in order."""

    parts: tuple[Grid | str, ...]

    def __str__(self) -> str:
        return self.text()

    def html(self) -> str:
        """Tables and paragraphs."""
        return "\n".join(
            html_table(part.rows[0], part.rows[1:]) if isinstance(part, Grid) else _html_line(part)
            for part in self.parts
        )

    def text(self, width: int | None = None, paint: Paint = plain) -> str:
        """Lines of at most `width` characters, words longer than that apart; None leaves every line whole."""
        lines: list[str] = []
        for part in self.parts:
            lines += _grid_lines(part, width, paint) if isinstance(part, Grid) else _wrapped(part, width)
        return "\n".join(lines)


def _wrapped(line: str, width: int | None) -> list[str]:
    if width is None or len(line) <= width:
        return [line]
    return textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _grid_lines(grid: Grid, width: int | None, paint: Paint) -> list[str]:
    head, *body = lines = aligned(grid.rows, grid.words)
    if width is not None and max(map(len, lines)) > width:
        return _fitted_lines(grid, width, paint)
    return [paint(head, "head"), *(_painted(line, row, paint) for line, row in zip(body, grid.rows[1:], strict=True))]


def _painted(line: str, row: Sequence[str], paint: Paint) -> str:
    """A line of the table with the verdict in it, if there is one, in its tone."""
    for text in row:
        if text in TONES:
            before, _, after = line.rpartition(text)
            return f"{before}{paint(text, TONES[text])}{after}"
    return line


def _fitted_lines(grid: Grid, width: int, paint: Paint) -> list[str]:
    """The columns that there is room for; the others below, where there is much of it, or which ones are left out."""
    rows = [[_shortened(row[0]), *row[1:]] for row in grid.rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    least = list(widths)
    if grid.sentences is not None:
        least[grid.sentences] = min(NARROWEST, widths[grid.sentences])
    kept = 1
    while kept < len(widths) and sum(least[: kept + 1]) + 2 * kept <= width:
        kept += 1
    lines: list[str] = []
    if grid.sentences is None or grid.sentences >= kept:
        lines = _grid_lines(Grid([row[:kept] for row in rows], grid.words), None, paint)
    else:
        room = width - sum(least[:kept]) - 2 * (kept - 1) + least[grid.sentences]
        lines = _with_sentences([row[:kept] for row in rows], grid.words, grid.sentences, room, paint)
    missing = rows[0][kept:]
    named = grid.words if isinstance(grid.words, int) else 1
    if missing and width >= ROOMY and kept > named:
        rest = Grid([[*row[:named], *row[kept:]] for row in rows], named)
        return [*lines, "", *_grid_lines(rest, width, paint)]
    said = f"left out at {width} characters: {', '.join(missing)} (--wide shows all)"
    return lines + ([paint(line, "faint") for line in _wrapped(said, width)] if missing else [])


def _with_sentences(
    rows: list[list[str]], words: int | Collection[int], place: int, room: int, paint: Paint
) -> list[str]:
    """Lines of a table in which the texts of one column go on in further lines."""
    tall: list[list[str]] = []
    begins: list[list[str] | None] = []  # the row that begins at a line; None where one goes on
    for row in rows:
        pieces = textwrap.wrap(row[place], room, break_on_hyphens=False) or [""]
        tall.append([*row[:place], pieces[0], *row[place + 1 :]])
        tall += [["" if each != place else piece for each in range(len(row))] for piece in pieces[1:]]
        begins += [row, *(None for _ in pieces[1:])]
    lines = aligned(tall, words)
    painted = [line if row is None else _painted(line, row, paint) for line, row in zip(lines, begins, strict=True)]
    return [paint(painted[0].rstrip(), "head"), *(line.rstrip() for line in painted[1:])]


def _shortened(name: str) -> str:
    """A long name without its middle."""
    if len(name) <= LONGEST_NAME:
        return name
    half = (LONGEST_NAME - 3) // 2
    return f"{name[:half]}...{name[-half:]}"


def _html_line(line: str) -> str:
    return f"<p>{html.escape(line)}</p>" if line else ""
