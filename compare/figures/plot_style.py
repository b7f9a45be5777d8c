"""How figures look: colours for colour-blind readers, line styles for grey print, sizes for the page."""

from __future__ import annotations

import re
from collections.abc import Iterable
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation

from slamgauge.compare.estimators.registry import BOUNDS, REGISTRY
from slamgauge.compare.estimators.registry import DEAD_RECKONING as DEAD_RECKONING

LineStyle = str | tuple[int, tuple[float, ...]]

TRUTH_COLOR = "#000000"
MARK_COLOR = "#777777"  # loop closures and other marks that are no data


PRINT: dict[Any, Any] = {
    "font.size": 7.5,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "text.parse_math": False,  # names of others may hold dollars; numbers on axes are plain (`plain_numbers`)
    "svg.hashsalt": "slamgauge",  # the same run gives the same file
    "svg.fonttype": "none",  # text stays text: it can be searched, and edited
    "path.simplify_threshold": 0.5,  # pixels, points in SVG: less cannot be seen
}
WRAPPED: dict[str, Any] = {"wrap": True, "parse_math": True}  # what is wrapped is read for formulas: `math_text`
LEGEND: dict[str, Any] = {"frameon": False, "handlelength": 2.6, "handletextpad": 0.6, "columnspacing": 1.2}


_PATH = re.compile(r' d="[^"]*"')
_DIGITS = re.compile(r"(\.\d\d)\d+")


class _PlainLogarithm(LogFormatterSciNotation):
    """Which ticks get a number is matplotlib's choice; the number is a plain one."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plain_numbers(axis: Axis) -> None:
    """Numbers of a logarithmic axis without powers of ten, which are formulas."""
    axis.set_major_formatter(_PlainLogarithm())
    axis.set_minor_formatter(_PlainLogarithm())


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


def save_png_and_svg(figure: Figure, path: Path) -> None:
    """Write `path`.png (200 dpi) and `path`.svg; the same figure gives the same files."""
    figure.savefig(path.with_suffix(".png"), dpi=200)
    svg = StringIO()
    figure.savefig(svg, format="svg", metadata={"Date": None})
    path.with_suffix(".svg").write_text(_thinned(svg.getvalue()), encoding="utf-8")


def _thinned(svg: str) -> str:
    """The coordinates of its paths in hundredths of a point."""
    return _PATH.sub(lambda path: _DIGITS.sub(r"\1", path.group()), svg)
