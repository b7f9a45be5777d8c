"""Axes: limits without diverged estimators, origins of large coordinates, and few ticks on logarithmic axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, ScalarFormatter

from slamgauge.arrays import Float

DIVERGED = 5.0  # an extent above this multiple of the median is ignored
DIVERGED_LOG = 100.0  # the same for logarithmic axes
NARROW, WIDE = 0.6, 2.5  # decades of an axis between which ticks are at 1, 2, 5; outside at tens or linear
FAR = 10_000.0  # smaller values need no offset
MINUS = "\N{MINUS SIGN}"
THIN = "\N{NARROW NO-BREAK SPACE}"


def robust_limits(extents: Mapping[str, Float], factor: float = DIVERGED) -> tuple[Float, list[str]]:
    """Return heights (K,) of K panels without the diverged estimators, and the names of these.

    Args:
        extents: Largest value (K,) of each estimator in each panel, not negative.
        factor: Largest extent that counts, as a multiple of the median.
    """
    rows = np.array([*extents.values()])
    typical = np.sort(rows, axis=0)[(len(rows) - 1) // 2]
    counts = rows <= np.where(typical > 0.0, factor * typical, np.inf)
    heights = np.where(counts, rows, 0.0).max(axis=0)
    return heights, [name for name, row in zip(extents, counts, strict=True) if not row.all()]


def exceeding(names: list[str]) -> str:
    """Return a remark about the estimators whose curves exceed the axes; empty without names."""
    return f"{', '.join(names)} exceed{'s' * (len(names) == 1)} the axes" if names else ""


def logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with few ticks and plain numbers; call it after the data and limits are set."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axes.set(**{f"{which}scale": "log"})
    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low)
    round_numbers = LogLocator(subs=(1.0, 2.0, 5.0), numticks=12) if decades < WIDE else LogLocator(numticks=7)
    axis.set_major_locator(MaxNLocator(4) if decades < NARROW else round_numbers)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


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
    formatter = _Relative(useOffset=origin)  # a number is the offset
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
