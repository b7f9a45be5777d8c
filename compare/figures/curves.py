"""Curves, bands, bounds, limits and ticks of all figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from numpy.typing import ArrayLike

from slamgauge.arrays import Float
from slamgauge.compare.figures.plot_style import MARK_COLOR, Style

DIVERGED = 5.0  # an extent above this multiple of the median is ignored
DIVERGED_LOG = 100.0  # the same for logarithmic axes
NARROW, WIDE = 0.6, 2.5  # decades of an axis between which ticks are at 1, 2, 5; outside at tens or linear
LONG = 10_000  # points; a longer curve is an image in SVG and PDF files


def curve(axes: Axes, x: ArrayLike, y: Float, style: Style, label: str = "", **more: Any) -> None:
    """Draw a curve (n,) in the style of an estimator."""
    look: dict[str, Any] = {"linewidth": 0.9, "rasterized": len(y) > LONG, **more}
    axes.plot(x, y, color=style.color, linestyle=style.dashes, label=label, **look)


def band(axes: Axes, x: ArrayLike, low: Float, high: Float, label: str = "", color: str = MARK_COLOR) -> None:
    """Fill the area between two curves (n,)."""
    axes.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0, label=label, rasterized=len(low) > LONG)


def three_sigma(axes: Axes, x: ArrayLike, sigma: Float, style: Style, *, filled: bool) -> None:
    """Draw the bounds of three standard deviations (n,) as thin lines, and fill the area between them."""
    if filled:
        band(axes, x, -3.0 * sigma, 3.0 * sigma, color=style.color)
    look: dict[str, Any] = {"linewidth": 0.5, "alpha": 0.8, "zorder": 2, "rasterized": len(sigma) > LONG}
    axes.plot(x, -3.0 * sigma, color=style.color, **look)
    axes.plot(x, 3.0 * sigma, color=style.color, **look)


def robust_limits(extents: Mapping[str, Float], *, is_log: bool = False) -> tuple[Float, list[str]]:
    """Return heights (K,) of K panels without the diverged estimators, and the names of these.

    `extents` are the largest values (K,) of each estimator in the panels, not negative; `is_log`: axes are logarithmic.
    """
    rows, factor = np.array([*extents.values()]), DIVERGED_LOG if is_log else DIVERGED
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
