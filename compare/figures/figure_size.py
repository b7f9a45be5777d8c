"""What figures are printed on: how wide it is, and which files are written of them."""

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
INCHES: dict[Width, float] = {"column": 3.4, "page": 7.0}  # of a paper in two columns
ENTRY = 1.1  # [in] of a legend
NARROW = 4.0  # [in]: below it panels stand one above the other


class Sheet(NamedTuple):
    """How wide figures are at most, and in which forms they are written."""

    width: Width = "page"
    formats: Sequence[Format] = ("png", "svg")

    @property
    def inches(self) -> float:
        """The width [in]."""
        return INCHES[self.width]

    @property
    def is_narrow(self) -> bool:
        """Whether panels stand one above the other."""
        return self.inches < NARROW

    def legend_columns(self, entries: int) -> int:
        """How many entries of a legend stand side by side, rows being alike in length."""
        rows = -(-entries // max(int(self.inches / ENTRY), 1))
        return -(-entries // max(rows, 1)) or 1


USUAL = Sheet()
_SHEET: ContextVar[Sheet] = ContextVar("_SHEET", default=USUAL)


def sheet() -> Sheet:
    """What figures are printed on now."""
    return _SHEET.get()


@contextmanager
def printed_on(chosen: Sheet) -> Generator[None]:
    """Within the block figures are printed on this."""
    token = _SHEET.set(chosen)
    try:
        yield
    finally:
        _SHEET.reset(token)


def save_printed(figure: Figure, path: Path) -> None:
    """Write `path` with the endings that the sheet says (png at 200 dpi); the same figure gives the same files."""
    for each in sheet().formats:
        if each == "svg":
            path.with_suffix(".svg").write_bytes(small_svg(figure))
        else:
            undated = {"CreationDate": None} if each == "pdf" else {}
            figure.savefig(path.with_suffix(f".{each}"), dpi=200, metadata=undated)
