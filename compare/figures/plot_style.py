"""How figures look: colours for colour-blind readers, line styles for grey print, sizes for the page."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

LineStyle = str | tuple[int, tuple[float, ...]]

DEAD_RECKONING = "dead-reckoning"
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
    "svg.hashsalt": "slamgauge",  # the same run gives the same file
}
LEGEND: dict[str, Any] = {"frameon": False, "handlelength": 2.6, "handletextpad": 0.6, "columnspacing": 1.2}


class Style(NamedTuple):
    """Colour and dashes of one estimate, in paths and in error curves alike."""

    color: str
    dashes: LineStyle


# after P. Tol, "Colour schemes" (SRON/EPS/TN/09-002)
KNOWN = {
    DEAD_RECKONING: Style("#009988", (0, (1, 1.4))),
    "ekf": Style("#CC3311", (0, (5, 1.2))),
    "riekf": Style("#0077BB", (0, (4, 1, 1, 1))),
    "isam2": Style("#CC9900", (0, (2, 1))),
    "batch": Style("#882288", (0, (7, 1, 1, 1, 1, 1))),
    "fej-ekf": Style("#33BBEE", (0, (3, 1, 1, 1, 1, 1))),
    "iekf": Style("#775522", (0, (9, 2))),
}
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
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
