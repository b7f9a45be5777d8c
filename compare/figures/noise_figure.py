"""Figure of `slamgauge noise`: sigmas, and NIS by landmark.

Values with the assumed noise have the key "before" in noise.json; values with the estimated noise have "after".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float
from slamgauge.compare.figures.axes import band, logarithmic
from slamgauge.compare.figures.plot_style import TRUTH_COLOR, legend_below, printed, sheet
from slamgauge.compare.noise.tables import verdict
from slamgauge.compare.scoring.intervals import Interval

BEFORE, AFTER = "#EE7733", "#0077BB"
LOOKS: dict[str, dict[str, Any]] = {  # styles of assumed and estimated values, by their key in noise.json
    "before": {"color": BEFORE, "fillstyle": "none"},
    "after": {"color": AFTER, "fillstyle": "full"},
}
WORDS = {"before": "assumed", "after": "found"}
MARKERS = ("o", "^")  # one per channel
SHOWN = 20.0  # largest ratio of estimated and assumed sigma on the axis


def save_noise_figure(out: Path, content: dict[str, Any]) -> None:
    """Write the figure `noise` into `out`; `content` is the content of noise.json."""
    shape, height = ((2, 1), 4.6) if sheet().is_narrow else ((1, 2), 2.9)
    with printed(out / "noise", height) as figure:
        sigmas, nis = figure.subplots(*shape).flat
        _draw_sigmas(sigmas, content["parameters"])
        _draw_nis(nis, content["nis_by_landmark"])
        legend_below(figure, nis.get_legend_handles_labels()[0])


def _draw_sigmas(axes: Axes, parameters: dict[str, Any]) -> None:
    """Draw each estimated sigma with its 95 % interval, divided by the assumed sigma.

    If the assumed sigma is 0, the divisor is the upper end of the interval, or the estimate without that end.
    """
    for place, content in enumerate(parameters.values()):
        found, assumed = Interval(content["sigma"], content["low"], content["high"]), content["assumed"]
        over = assumed or found.high or found.mean
        low = max((found.low or 0.0) / over, 1 / SHOWN)
        high = SHOWN if found.high is None else min(found.high / over, SHOWN)
        axes.plot([low, high], [place, place], color=AFTER, linewidth=1.5)
        if found.low:
            axes.plot(found.mean / over, place, "o", color=AFTER, markersize=4)
        text = f"{found.mean:.3g}: {verdict(found, assumed)}" if found.low else verdict(found, 0.0)
        axes.text(0.03, place - 0.2, text, transform=axes.get_yaxis_transform(), fontsize=6)
    axes.axvline(1.0, color=BEFORE, linewidth=0.8, linestyle="--")
    axes.set_yticks(range(len(parameters)), [*parameters])
    axes.set_ylim(len(parameters) - 0.5, -0.7)
    axes.set(xscale="log", xlabel="sigma found / assumed, 95 % interval", title="noise")
    low, high = axes.get_xlim()
    axes.set_xlim(min(max(low, 1 / SHOWN), 0.5), max(min(high, SHOWN), 2.0))
    logarithmic(axes, "x")
    axes.grid(visible=True, axis="x", which="major", linewidth=0.3)


def _draw_nis(axes: Axes, nis_by_landmark: dict[str, Any]) -> None:
    """Draw the mean NIS per row of each landmark, in the order of ids, and its 95 % band."""
    for (channel, by_landmark), marker in zip(nis_by_landmark.items(), MARKERS, strict=False):
        for which, look in LOOKS.items():
            label = f"{channel}, {WORDS[which]}"
            axes.plot(_column(by_landmark, which), linestyle="none", marker=marker, label=label, **look)
    first = next(iter(nis_by_landmark.values()))
    band(axes, range(len(first)), _column(first, "low"), _column(first, "high"), "95 % band")
    axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.5)
    axes.set(xlabel="landmarks in the order of ids", ylabel="NIS per row", title="by landmark")
    logarithmic(axes, "y")
    axes.set_xticks([])


def _column(by_landmark: dict[str, dict[str, Any]], key: str) -> Float:
    """Return the value of `key` of each landmark, NaN for None."""
    return np.array([row[key] for row in by_landmark.values()], dtype=np.float64)
