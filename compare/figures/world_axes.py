"""Readable axes for large coordinates, such as UTM positions and seconds since 1970."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import ScalarFormatter

FAR = 10_000.0  # smaller values need no offset
MINUS = "\N{MINUS SIGN}"
THIN = "\N{NARROW NO-BREAK SPACE}"


class _From(ScalarFormatter):
    """Formatter of plain numbers relative to an origin that the axis label names."""

    def __init__(self, origin: float) -> None:
        super().__init__(useOffset=False)
        self._origin = origin
        self.set_scientific(False)

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x - self._origin, pos)

    def format_ticks(self, values: list[float]) -> list[str]:
        distances = [value - self._origin for value in values]
        self.set_locs(distances)
        return [super(_From, self).__call__(each) for each in distances]


def label_plane(ax: Axes, *, x: bool = True, y: bool = True) -> None:
    """Show x and y [m] of a map (world frame) relative to round numbers; label the chosen axes."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    extent = max(right - left, top - bottom)
    from_x = _count_from(ax.xaxis, round_origin(left, right, extent))
    from_y = _count_from(ax.yaxis, round_origin(bottom, top, extent))
    if x:
        ax.set_xlabel(f"x{from_x} [m]")
    if y:
        ax.set_ylabel(f"y{from_y} [m]")


def label_time(ax: Axes) -> str:
    """Show the time relative to a round number, and return the label of the axis."""
    begin, end = ax.get_xlim()
    return f"time{_count_from(ax.xaxis, round_origin(begin, end, end - begin))} [s]"


def _count_from(axis: Axis, origin: float) -> str:
    """Show ticks relative to `origin`, and return the text for the label."""
    axis.set_major_formatter(_From(origin))
    return f" {MINUS if origin > 0 else '+'} {abs(origin):,.10g}".replace(",", THIN) if origin else ""


def round_origin(begin: float, end: float, extent: float) -> float:
    """Return a round number near the middle of an axis, or 0 if the axis is near 0.

    It is a multiple of the smallest power of ten above `extent`.
    """
    if max(abs(begin), abs(end)) < FAR or not extent > 0:
        return 0.0
    unit = 10.0 ** math.ceil(math.log10(extent))
    return unit * round((begin + end) / 2 / unit)
