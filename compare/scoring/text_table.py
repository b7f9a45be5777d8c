"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.compare.scoring.intervals import Interval


def aligned(rows: Sequence[Sequence[str]], words: int) -> list[str]:
    """Lines of equal columns: the first `words` to the left, the figures after them to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if place < words else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]


def cell(value: float | None, form: str) -> str:
    """A figure formatted by `form`, `-` where there is none."""
    return "-" if value is None else form.format(value)


def interval_cell(interval: Interval | None, form: str) -> str:
    """`mean ± half width`, `-` where there is none."""
    if interval is None or interval.low is None or interval.high is None:
        return cell(None if interval is None else interval.mean, form)
    return f"{form.format(interval.mean)} ± {form.format((interval.high - interval.low) / 2)}"


def marked(text: str, mark: str, *, is_marked: bool) -> str:
    """A cell of a column in which some are marked behind their figure: the others leave the place of the mark free."""
    return text + (mark if is_marked and text != "-" else " " * len(mark))
