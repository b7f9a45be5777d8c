"""Width and file formats of figures."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Literal, NamedTuple

from matplotlib.figure import Figure

from slamgauge.compare.figures.svg_size import small_svg

Format = Literal["pdf", "png", "svg"]
Width = Literal["column", "page"]
INCHES: dict[Width, float] = {"column": 3.4, "page": 7.0}  # widths in a paper with two columns
ENTRY = 1.1  # [in] width of a legend entry
NARROW = 4.0  # [in]; narrower figures have one column of panels


class Sheet(NamedTuple):
    """Largest width and file formats of figures."""

    width: Width = "page"
    formats: Sequence[Format] = ("png", "svg")

    @property
    def inches(self) -> float:
        """The width [in]."""
        return INCHES[self.width]

    @property
    def is_narrow(self) -> bool:
        """Whether the figure has one column of panels."""
        return self.inches < NARROW

    def legend_columns(self, entries: int) -> int:
        """Return the number of legend columns for rows of about equal length."""
        rows = -(-entries // max(int(self.inches / ENTRY), 1))
        return -(-entries // max(rows, 1)) or 1


USUAL = Sheet()
_SHEET: ContextVar[Sheet] = ContextVar("_SHEET", default=USUAL)


def sheet() -> Sheet:
    """Return the current sheet."""
    return _SHEET.get()


@contextmanager
def printed_on(chosen: Sheet) -> Generator[None]:
    """Use the sheet for all figures of the block."""
    token = _SHEET.set(chosen)
    try:
        yield
    finally:
        _SHEET.reset(token)


def save_printed(figure: Figure, path: Path) -> None:
    """Write the figure in the formats of the sheet (png at 200 dpi); files contain no date."""
    for each in sheet().formats:
        if each == "svg":
            path.with_suffix(".svg").write_bytes(small_svg(figure))
        else:
            undated = {"CreationDate": None} if each == "pdf" else {}
            figure.savefig(path.with_suffix(f".{each}"), dpi=200, metadata=undated)
