"""Layout of printed results: tables and lines of text within a width."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from slamgauge.compare.scoring.table import NO_FIGURE, Table
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
class Page:
    """Tables and lines, in order."""

    parts: tuple[Table | str, ...]

    def __str__(self) -> str:
        return self.text()

    def html(self) -> str:
        """Return tables and paragraphs for a notebook."""
        return "\n".join(_html_table(part) if isinstance(part, Table) else _html_line(part) for part in self.parts)

    def text(self, width: int | None = None, paint: Paint = plain) -> str:
        """Return lines of at most `width` characters, except for longer words; None sets no limit.

        A table has full names in its head, or else short titles, or else the last columns are hidden.
        """
        lines: list[str] = []
        for part in self.parts:
            lines += _table_lines(part, width, paint) if isinstance(part, Table) else _wrapped(part, width)
        return "\n".join(lines)


def aligned(rows: Sequence[Sequence[str]], words: Collection[int]) -> list[str]:
    """Return rows as lines without trailing blanks: `words` columns left-aligned, others right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.ljust(width) if place in words else text.rjust(width)
            for place, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _wrapped(line: str, width: int | None) -> list[str]:
    if width is None or len(line) <= width:
        return [line]
    return textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _table_lines(table: Table, width: int | None, paint: Paint) -> list[str]:
    rows = [[cell.text for cell in row] for row in table.rows]
    words = [place for place, head in enumerate(table.heads) if head.words]
    titles = [head.title for head in table.heads]
    for head in ([head.full for head in table.heads], titles):
        lines = aligned([head, *rows], words)
        if width is None or max(map(len, lines)) <= width:
            return _painted(lines, rows, paint)
    return _fitted_lines(table, [titles, *rows], words, width or 0, paint)


def _painted(lines: Sequence[str], rows: Sequence[Sequence[str] | None], paint: Paint) -> list[str]:
    """Return the lines of a table; each but the head is of the row of `rows`, or of none."""
    body = zip(lines[1:], rows, strict=True)
    return [paint(lines[0].rstrip(), "head"), *(_with_verdict(line, row or (), paint) for line, row in body)]


def _with_verdict(line: str, row: Sequence[str], paint: Paint) -> str:
    """Return a line of a table with its verdict, if it has one, in the verdict's tone."""
    for text in row:
        if text in TONES:
            before, _, after = line.rpartition(text)
            return f"{before}{paint(text, TONES[text])}{after}"
    return line


def _fitted_lines(table: Table, rows: list[list[str]], words: list[int], width: int, paint: Paint) -> list[str]:
    """Return the columns that fit, and below them the names of the others that have figures."""
    rows = [[_shortened(row[0]), *row[1:]] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    wraps = next((place for place, head in enumerate(table.heads) if head.wraps), None)
    least = list(widths)
    if wraps is not None:
        least[wraps] = min(NARROWEST, widths[wraps])
    kept = 1
    while kept < len(widths) and sum(least[: kept + 1]) + 2 * kept <= width:
        kept += 1
    shown = [row[:kept] for row in rows]
    if wraps is None or wraps >= kept:
        lines = _painted(aligned(shown, words), shown[1:], paint)
    else:
        room = width - sum(least[:kept]) - 2 * (kept - 1) + least[wraps]
        lines = _with_sentences(shown, words, wraps, room, paint)
    names = enumerate(table.heads[kept:], kept)
    hidden = [head.full for place, head in names if any(row[place] != NO_FIGURE for row in rows[1:])]
    if not hidden:
        return lines
    note = f"Hidden columns (show with --wide): {', '.join(hidden)}"
    return lines + [paint(line, "faint") for line in _wrapped(note, width)]


def _with_sentences(rows: list[list[str]], words: list[int], place: int, room: int, paint: Paint) -> list[str]:
    """Return the lines of a table in which the texts of column `place` continue on further lines."""
    tall: list[list[str]] = []
    begins: list[list[str] | None] = []  # the row that begins at a line; None for a continuation
    for row in rows:
        pieces = textwrap.wrap(row[place], room, break_on_hyphens=False) or [""]
        tall.append([*row[:place], pieces[0], *row[place + 1 :]])
        tall += [["" if each != place else piece for each in range(len(row))] for piece in pieces[1:]]
        begins += [row, *(None for _ in pieces[1:])]
    return _painted(aligned(tall, words), begins[1:], paint)


def _shortened(name: str) -> str:
    """Return the name, without its middle if it is long."""
    if len(name) <= LONGEST_NAME:
        return name
    half = (LONGEST_NAME - 3) // 2
    return f"{name[:half]}...{name[-half:]}"


def _html_table(table: Table) -> str:
    return html_table([head.full for head in table.heads], [[cell.text for cell in row] for row in table.rows])


def _html_line(line: str) -> str:
    return f"<p>{html.escape(line)}</p>" if line else ""
