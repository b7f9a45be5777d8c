"""Style of figures: colours for colour-blind readers, line styles for grey print, sizes for the page."""

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
MARK_COLOR = "#777777"  # loop closures and other marks
MOST_AT_ONCE = 20_000  # points of a line that are drawn together; a path of a thousand loops needs 100 MB in one piece
NARROW, WIDE = 0.6, 2.5  # decades of a logarithmic axis between which ticks are at 1, 2, 5


STYLE = Path(errors.__file__).with_name("paper.mplstyle")  # users load it by the name slamgauge.paper
PRINT: dict[Any, Any] = {
    **mpl.rc_params_from_file(STYLE, use_default_template=False),
    "figure.constrained_layout.use": False,  # figures that need it set it themselves
    "text.parse_math": False,  # user-given names may contain dollars; numbers on axes are plain (`logarithmic`)
    "svg.hashsalt": "slamgauge",  # files are reproducible
    "agg.path.chunksize": MOST_AT_ONCE,
}
WRAPPED: dict[str, Any] = {"wrap": True, "parse_math": True}  # wrapped texts may contain formulas: see `math_text`
LEGEND: dict[str, Any] = {"frameon": False, "handlelength": 2.6, "handletextpad": 0.6, "columnspacing": 1.2}


def logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with few ticks and plain numbers; call it after the data and limits are set."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axes.set(**{f"{which}scale": "log"})
    low, high = sorted(axis.get_view_interval())
    axis.set_major_locator(_few_ticks(low, high))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def _few_ticks(low: float, high: float) -> Locator:
    """Return a locator of at most about eight round numbers between two positive limits."""
    decades = math.log10(high / low)
    if decades < NARROW:
        return MaxNLocator(4)
    if decades < WIDE:
        return LogLocator(subs=(1.0, 2.0, 5.0), numticks=12)
    return LogLocator(numticks=7)


class Style(NamedTuple):
    """Colour and dashes of one estimate, for paths and error curves."""

    color: str
    dashes: LineStyle


# styles of built-in estimators; user estimators take those of `USER_STYLES`
KNOWN = {name: Style(*entry.look) for name, entry in (REGISTRY | BOUNDS).items() if entry.look is not None}
USER_STYLES = (
    Style("#332288", (0, (4, 2))),
    Style("#999933", (0, (6, 1, 2, 1))),
    Style("#EE7733", (0, (1.5, 0.8))),
    Style("#AA3377", (0, (3, 2, 1, 2))),
    Style("#44AA99", (0, (8, 1, 1, 1))),
    Style("#555555", (0, (2, 2))),
)


def styles(names: Iterable[str]) -> dict[str, Style]:
    """Return a style for each name; names without one in the registry take `USER_STYLES` in turn."""
    chosen: dict[str, Style] = {}
    users = 0
    for name in names:
        if name in KNOWN:
            chosen[name] = KNOWN[name]
        else:
            chosen[name] = USER_STYLES[users % len(USER_STYLES)]
            users += 1
    return chosen
