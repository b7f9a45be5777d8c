"""Write SVG files below a size limit, with rounded coordinates and simplified curves."""

from __future__ import annotations

import re
from io import BytesIO

import matplotlib as mpl
from matplotlib.figure import Figure

LARGEST = 500_000  # bytes
THRESHOLDS = (0.25, 0.5, 1.0)  # [pt] by which a simplified curve may miss its points; nobody sees the first
COORDINATES = re.compile(rb' (?:d|x|y)="[^"]*"')  # coordinates of paths and markers
DIGITS = re.compile(rb"(\.\d\d)\d+")


def small_svg(figure: Figure) -> bytes:
    """Return the figure as SVG; curves are simplified until it is smaller than `LARGEST` bytes, if possible."""
    svg = b""
    for threshold in THRESHOLDS:
        svg = _svg(figure, threshold)
        if len(svg) < LARGEST:
            break
    return svg


def _svg(figure: Figure, threshold: float) -> bytes:
    with mpl.rc_context({"path.simplify_threshold": threshold}):
        for axes in figure.axes:
            for line in axes.lines:
                line.recache(always=True)  # a path keeps the threshold of its creation
        written = BytesIO()
        figure.savefig(written, format="svg", metadata={"Date": None})
    return COORDINATES.sub(lambda found: DIGITS.sub(rb"\1", found[0]), written.getvalue())
