"""Cells and lines of tables."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from slamgauge.compare.scoring.intervals import Interval

VAST = 1e9  # figures from here on are written with an exponent, to keep columns narrow
NO_FIGURE = "-"  # text of None


def aligned(rows: Sequence[Sequence[str]], words: int | Collection[int]) -> list[str]:
    """Return rows as lines without trailing blanks: `words` columns (count or places) left-aligned, others right."""
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
    """Return a figure formatted by `form`, `-` for None; a figure that is rounded to 0 has no minus."""
    if value is None:
        return NO_FIGURE
    text = form.format(value) if abs(value) < VAST else f"{value:.3g}"
    return form.format(0.0) if text.startswith("-") and not set(text) & set("123456789") else text


def interval_cell(interval: Interval | None, form: str) -> str:
    """Return `mean ± half width`, or `-` for None."""
    if interval is None or interval.low is None or interval.high is None:
        return cell(None if interval is None else interval.mean, form)
    return f"{cell(interval.mean, form)} ± {cell((interval.high - interval.low) / 2, form)}"


def marked(text: str, mark: str, *, is_marked: bool) -> str:
    """Return a cell with the mark, or with blanks instead, to keep the figures of a column aligned."""
    return text + (mark if is_marked and text != "-" else " " * len(mark))
