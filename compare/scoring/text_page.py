"""Layout of printed results: tables and lines of text within a width."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Literal

from slamgauge.compare.scoring.table import NO_FIGURE, Head, Table
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
        return "\n".join(_html(part) for part in self.parts)

    def text(self, width: int | None = None, paint: Paint = plain) -> str:
        """Return lines of at most `width` characters, except for longer words; None sets no limit.

        A table has full names in its head, or else short titles, or else the last columns are hidden.
        """
        lines: list[str] = []
        for part in self.parts:
            lines += _table_lines(part, width, paint) if isinstance(part, Table) else _wrapped(part, width)
        return "\n".join(lines)


def _html(part: Table | str) -> str:
    if isinstance(part, Table):
        return html_table([head.full for head in part.heads], part.texts()[1:])
    return f"<p>{html.escape(part)}</p>" if part else ""


def _wrapped(line: str, width: int | None) -> list[str]:
    if width is None or len(line) <= width or "\n" in line:  # a refusal of user code ends with a wrapper to copy
        return [line]
    return textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _table_lines(table: Table, width: int | None, paint: Paint) -> list[str]:
    titles, *rows = table.texts()
    for head in ([head.full for head in table.heads], titles):
        if width is None or sum(_widths([head, *rows])) + 2 * len(head) - 2 <= width:
            return _aligned([head, *rows], table.heads, paint)
    return _fitted_lines(table, width or 0, paint)


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


def _aligned(rows: Sequence[Sequence[str]], heads: Sequence[Head], paint: Paint) -> list[str]:
    """Return rows, first the titles, as lines without trailing blanks: words at the left, verdicts in their tone."""
    lines: list[str] = []
    widths = _widths(rows)
    for row in rows:
        parts: list[str] = []
        for text, width, head in zip(row, widths, heads, strict=False):
            shown, blanks = paint(text, TONES.get(text, "plain")), " " * (width - len(text))
            parts.append(shown + blanks if head.words else blanks + shown)
        lines.append("  ".join(parts).rstrip())
    return [paint(lines[0], "head"), *lines[1:]]


def _fitted_lines(table: Table, width: int, paint: Paint) -> list[str]:
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
    lines = _aligned(tall, table.heads, paint)
    names = enumerate(table.heads[kept:], kept)
    hidden = [head.full for place, head in names if any(row[place] != NO_FIGURE for row in rows[1:])]
    note = f"Hidden columns (show with --wide): {', '.join(hidden)}"
    return lines + [paint(line, "faint") for line in _wrapped(note, width) if hidden]


def _pieces(text: str, head: Head, room: int) -> list[str]:
    """Return a text in lines of at most `room` characters, if it may continue on further lines."""
    return textwrap.wrap(text, room, break_on_hyphens=False) or [""] if head.wraps else [text]


def _shortened(name: str) -> str:
    """Return the name, without its middle if it is long."""
    half = (LONGEST_NAME - 3) // 2
    return name if len(name) <= LONGEST_NAME else f"{name[:half]}...{name[-half:]}"
