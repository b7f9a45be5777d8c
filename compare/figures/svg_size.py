"""An SVG that stays small: where it does not, its curves have fewer points, their peaks among them."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from io import BytesIO

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slamgauge.arrays import Int
from slamgauge.compare.figures.downsampling import extreme_rows
from slamgauge.compare.figures.svg_paths import thinned

LARGEST = 500_000  # bytes
FEWEST = 50  # points of a curve, which a panel that is a column wide still needs
UNCONNECTED = ("None", "none", " ", "")  # styles of points alone: all of them are seen


def small_svg(figure: Figure) -> bytes:
    """The figure as an SVG; below `LARGEST` where fewer points of its curves help."""
    svg = _svg(figure)
    most = max((len(line.get_xdata()) for line in _curves(figure)), default=0) // 2  # pyright: ignore[reportArgumentType]
    while len(svg) >= LARGEST and most >= FEWEST:
        with _at_most(figure, most):
            svg = _svg(figure)
        most //= 2
    return svg


def _svg(figure: Figure) -> bytes:
    written = BytesIO()
    figure.savefig(written, format="svg", metadata={"Date": None})
    return thinned(written.getvalue())


def _curves(figure: Figure) -> list[Line2D]:
    lines = [line for axes in figure.axes for line in axes.lines]
    return [line for line in lines if line.get_linestyle() not in UNCONNECTED]


@contextmanager
def _at_most(figure: Figure, most: int) -> Generator[None]:
    """Within the block curves have so many points."""
    whole = [(line, *map(np.asarray, line.get_data())) for line in _curves(figure)]
    try:
        for line, x, y in whole:
            if len(x) > most:
                rows = _rows(x, y, most)
                line.set_data(x[rows], y[rows])
        yield
    finally:
        for line, x, y in whole:
            line.set_data(x, y)


def _rows(x: np.ndarray, y: np.ndarray, most: int) -> Int:
    """Which points of a curve show it: its peaks where it is one against time, evenly spread ones of a path."""
    if np.issubdtype(y.dtype, np.floating) and bool((np.diff(x) >= 0).all()):
        return extreme_rows(y, most)
    return np.unique(np.linspace(0, len(x) - 1, most).round().astype(np.int64))
