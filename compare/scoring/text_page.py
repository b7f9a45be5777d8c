"""Layout of printed results: tables and lines of text within a width."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from slamgauge.compare.scoring.table import NO_FIGURE, Head, Table
from slamgauge.display import html_table

LONGEST_NAME = 28  # characters of the first column if the width is limited; longer names lose their middle
NARROWEST = 22  # characters: least width of a column of sentences


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
