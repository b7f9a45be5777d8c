"""What all figures share: styles of estimators, width and formats, and curves, bands, bounds, limits and ticks.

Colours are for colour-blind readers, line styles for grey print.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import cycle
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from numpy.typing import ArrayLike

from slamgauge import errors
from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUND, DEAD_RECKONING, HINDSIGHT_BOUND

Format = Literal["pdf", "png", "svg"]
Width = Literal["column", "page"]
INCHES: dict[Width, float] = {"column": 3.4, "page": 7.0}  # widths in a paper with two columns
ENTRY = 1.1  # [in] width of a legend entry
CHARACTERS = 13  # characters of a title, per inch
DIVERGED = 5.0  # an extent above this multiple of the median is ignored
DIVERGED_LOG = 100.0  # the same for logarithmic axes
NARROW, WIDE = 0.6, 2.5  # decades of an axis between which ticks are at 1, 2, 5; outside at tens or linear
LONG = 10_000  # points; a longer curve is an image in SVG and PDF files
LineStyle = str | tuple[int, tuple[float, ...]]

TRUTH_COLOR = "#000000"
MARK_COLOR = "#777777"  # loop closures and other marks
STYLE = Path(errors.__file__).with_name("paper.mplstyle")  # users load it by the name slamgauge.paper
PRINT: dict[Any, Any] = {
    **mpl.rc_params_from_file(STYLE, use_default_template=False),
    "text.parse_math": False,  # user-given names may contain dollars; numbers on axes are plain (`logarithmic`)
    "svg.hashsalt": "slamgauge",  # files are reproducible
    "agg.path.chunksize": 20_000,  # a path of a thousand loops needs 100 MB in one piece
}
UNDATED: dict[Format, dict[str, None]] = {"pdf": {"CreationDate": None}, "png": {}, "svg": {"Date": None}}


class Style(NamedTuple):
    """Colour and dashes of one estimate, for paths and error curves."""

    color: str
    dashes: LineStyle


# styles of built-in estimators, others take those of `USER_STYLES`: P. Tol, "Colour schemes" (SRON/EPS/TN/09-002)
STYLES = {
    DEAD_RECKONING: Style("#009988", (0, (1, 1.4))),
    "textbook-ekf": Style("#6A5ACD", (0, (7, 3))),
    "ekf": Style("#CC3311", (0, (5, 1.2))),
    "fej-ekf": Style("#33BBEE", (0, (3, 1, 1, 1, 1, 1))),
    "oc-ekf": Style("#EE3377", (0, (6, 1, 1, 1, 3, 1))),
    "iekf": Style("#775522", (0, (9, 2))),
    "riekf": Style("#0077BB", (0, (4, 1, 1, 1))),
    "causal": Style("#CC9900", (0, (2, 1))),
    "batch": Style("#882288", (0, (7, 1, 1, 1, 1, 1))),
    "isam2": Style("#AAAA00", (0, (3, 3))),
    "gtsam-batch": Style("#4477AA", (0, (10, 2, 2, 2))),
    BOUND: Style("#000000", (0, (1, 1))),
    HINDSIGHT_BOUND: Style("#777777", (0, (1, 2))),
}
USER_STYLES = (
    Style("#332288", (0, (4, 2))),
    Style("#999933", (0, (6, 1, 2, 1))),
    Style("#EE7733", (0, (1.5, 0.8))),
    Style("#AA3377", (0, (3, 2, 1, 2))),
    Style("#44AA99", (0, (8, 1, 1, 1))),
    Style("#555555", (0, (2, 2))),
)


def styles(names: Iterable[str]) -> dict[str, Style]:
    """Return a style for each name; other names take `USER_STYLES` in turn."""
    users = cycle(USER_STYLES)
    return {name: STYLES.get(name) or next(users) for name in names}


class Sheet(NamedTuple):
    """Width and file formats of figures."""

    width: Width = "page"
    formats: Sequence[Format] = ("png", "svg")

    @property
    def inches(self) -> float:
        """The width [in]."""
        return INCHES[self.width]

    @property
    def is_narrow(self) -> bool:
        """Whether the figure has one column of panels."""
        return self.width == "column"


SHEET: ContextVar[Sheet] = ContextVar("SHEET", default=Sheet())  # noqa: B039 a tuple does not change


@contextmanager
def printed_on(chosen: Sheet) -> Generator[None]:
    """Use the sheet for all figures of the block."""
    token = SHEET.set(chosen)
    try:
        yield
    finally:
        SHEET.reset(token)


@contextmanager
def printed(path: Path, height: float, title: str = "") -> Generator[Figure]:
    """Yield a new figure of a height [in] in the print style, and write it at the end (see `save_printed`)."""
    inches = SHEET.get().inches
    with mpl.rc_context(PRINT):
        figure = Figure(figsize=(inches, height), layout="constrained")
        lines = [textwrap.fill(line, int(CHARACTERS * inches)) for line in title.splitlines()]
        figure.suptitle("\n".join(lines))
        yield figure
        save_printed(figure, path)


def save_printed(figure: Figure, path: Path) -> None:
    """Write the figure in the formats of the sheet (png at 200 dpi); files contain no date."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)  # it places the parts, once for all formats
        figure.set_layout_engine(None)  # with "none" each format would be drawn twice
    for form in SHEET.get().formats:
        figure.savefig(path.with_suffix(f".{form}"), metadata=UNDATED[form])


def legend_below(figure: FigureBase, handles: Sequence[Any]) -> None:
    """Draw a legend below all axes of the figure, in rows of about equal length."""
    in_row = max(int(SHEET.get().inches / ENTRY), 1)
    longest = max((len(each.get_label()) for each in handles), default=0)
    in_row = max(min(in_row, int(CHARACTERS * SHEET.get().inches) // (longest + 6)), 1)
    rows = -(-len(handles) // in_row)
    figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // max(rows, 1)) or 1)


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
    for side in (-3.0, 3.0):
        axes.plot(x, side * sigma, color=style.color, linewidth=0.5, alpha=0.8, zorder=2, rasterized=len(sigma) > LONG)


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
