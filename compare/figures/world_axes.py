"""Readable axes for large coordinates, such as UTM positions and seconds since 1970."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import ScalarFormatter

FAR = 10_000.0  # smaller values need no offset
MINUS = "\N{MINUS SIGN}"
THIN = "\N{NARROW NO-BREAK SPACE}"


class _Relative(ScalarFormatter):
    """Formatter whose offset is in the axis label, not next to the axis."""

    def get_offset(self) -> str:
        return ""


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
    formatter = _Relative(useOffset=origin)  # pyright: ignore[reportArgumentType] a number is the offset
    formatter.set_scientific(False)
    axis.set_major_formatter(formatter)
    return f" {MINUS if origin > 0 else '+'} {abs(origin):,.10g}".replace(",", THIN) if origin else ""


def round_origin(begin: float, end: float, extent: float) -> float:
    """Return a round number near the middle of an axis, or 0 if the axis is near 0.

    It is a multiple of the smallest power of ten above `extent`.
    """
    if max(abs(begin), abs(end)) < FAR or not extent > 0:
        return 0.0
    unit = 10.0 ** math.ceil(math.log10(extent))
    return unit * round((begin + end) / 2 / unit)
