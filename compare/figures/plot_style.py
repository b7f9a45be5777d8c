"""How figures look: colours for colour-blind readers, line styles for grey print, sizes for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.ticker import Locator, LogLocator, MaxNLocator, NullLocator

from slamgauge import errors
from slamgauge.compare.estimators.registry import BOUNDS, REGISTRY
from slamgauge.compare.estimators.registry import DEAD_RECKONING as DEAD_RECKONING

LineStyle = str | tuple[int, tuple[float, ...]]

TRUTH_COLOR = "#000000"
MARK_COLOR = "#777777"  # loop closures and other marks that are no data
MOST_AT_ONCE = 20_000  # points of a line: one that goes round a thousand times takes 100 MB if it is drawn at once
NARROW, WIDE = 0.6, 2.5  # decades of a logarithmic axis: below and above its ticks are not at 1, 2, 5


STYLE = Path(errors.__file__).with_name("paper.mplstyle")  # which people use by its name, slamgauge.paper
PRINT: dict[Any, Any] = {
    **mpl.rc_params_from_file(STYLE, use_default_template=False),
    "figure.constrained_layout.use": False,  # who needs it asks for it
    "text.parse_math": False,  # names of others may hold dollars; numbers on axes are plain (`logarithmic`)
    "svg.hashsalt": "slamgauge",  # the same run gives the same file
    "agg.path.chunksize": MOST_AT_ONCE,
}
WRAPPED: dict[str, Any] = {"wrap": True, "parse_math": True}  # what is wrapped is read for formulas: `math_text`
LEGEND: dict[str, Any] = {"frameon": False, "handlelength": 2.6, "handletextpad": 0.6, "columnspacing": 1.2}


def logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis, with its data and limits, logarithmic, with few ticks and plain numbers (powers are formulas)."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axes.set(**{f"{which}scale": "log"})
    low, high = sorted(axis.get_view_interval())
    axis.set_major_locator(_few_ticks(low, high))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def _few_ticks(low: float, high: float) -> Locator:
    """Round numbers between two positive ones, not more than some eight."""
    decades = math.log10(high / low)
    if decades < NARROW:
        return MaxNLocator(4)
    if decades < WIDE:
        return LogLocator(subs=(1.0, 2.0, 5.0), numticks=12)
    return LogLocator(numticks=7)


class Style(NamedTuple):
    """Colour and dashes of one estimate, in paths and in error curves alike."""

    color: str
    dashes: LineStyle


# of the estimators in the box; those that have none there, and people's own, take the guests'
KNOWN = {name: Style(*entry.look) for name, entry in (REGISTRY | BOUNDS).items() if entry.look is not None}
GUESTS = (
    Style("#332288", (0, (4, 2))),
    Style("#999933", (0, (6, 1, 2, 1))),
    Style("#EE7733", (0, (1.5, 0.8))),
    Style("#AA3377", (0, (3, 2, 1, 2))),
    Style("#44AA99", (0, (8, 1, 1, 1))),
    Style("#555555", (0, (2, 2))),
)


def styles(names: Iterable[str]) -> dict[str, Style]:
    """A style for each name, in order; names that are not in the box take the guests' in turn."""
    chosen: dict[str, Style] = {}
    guests = 0
    for name in names:
        if name in KNOWN:
            chosen[name] = KNOWN[name]
        else:
            chosen[name] = GUESTS[guests % len(GUESTS)]
            guests += 1
    return chosen
