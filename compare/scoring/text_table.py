"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from slamgauge.compare.scoring.intervals import Interval

VAST = 1e9  # figures from here on have an exponent, so that one lost filter does not make a table unreadable


def aligned(rows: Sequence[Sequence[str]], words: int | Collection[int]) -> list[str]:
    """Columns as lines: the first `words`, or those of these places, to the left, the figures to the right.

    No line ends in blanks.
    """
    left = range(words) if isinstance(words, int) else words
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if place in left else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def cell(value: float | None, form: str) -> str:
    """A figure formatted by `form`, `-` where there is none; what is rounded to 0 has no minus."""
    if value is None:
        return "-"
    text = form.format(value) if abs(value) < VAST else f"{value:.3g}"
    return form.format(0.0) if text.startswith("-") and not set(text) & set("123456789") else text


def interval_cell(interval: Interval | None, form: str) -> str:
    """`mean ± half width`, `-` where there is none."""
    if interval is None or interval.low is None or interval.high is None:
        return cell(None if interval is None else interval.mean, form)
    return f"{cell(interval.mean, form)} ± {cell((interval.high - interval.low) / 2, form)}"


def marked(text: str, mark: str, *, is_marked: bool) -> str:
    """A cell of a column in which some are marked behind their figure: the others leave the place of the mark free."""
    return text + (mark if is_marked and text != "-" else " " * len(mark))
