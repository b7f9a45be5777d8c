"""Figure of `slamgauge noise`, with four panels: sigmas, NIS by landmark, quantiles and whiteness.

Values with the assumed noise have the key "before" in noise.json; values with the estimated noise have "after".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float
from slamgauge.compare.figures.axes import logarithmic
from slamgauge.compare.figures.plot_style import MARK_COLOR, TRUTH_COLOR, legend_below, printed, sheet
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
LEAST_CORRELATION = 0.1  # the axis reaches at least this correlation


def save_noise_figure(out: Path, content: dict[str, Any]) -> None:
    """Write the figure `noise` into `out`; `content` is the content of noise.json."""
    shape, height = ((4, 1), 8.6) if sheet().is_narrow else ((2, 2), 5.4)
    with printed(out / "noise", height) as figure:
        sigmas, nis, quantiles, whiteness = figure.subplots(*shape).flat
        _draw_sigmas(sigmas, content["parameters"])
        _draw_nis(nis, content["nis_by_landmark"])
        _draw_quantiles(quantiles, content["quantiles"])
        _draw_whiteness(whiteness, content["autocorrelation"])
        legend_below(figure, quantiles.get_legend_handles_labels()[0])


def _series(by_channel: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, dict[str, Any]]]:
    """Yield values, the key "before" or "after", and plot arguments, for each channel and key."""
    for (channel, found), marker in zip(by_channel.items(), MARKERS, strict=False):
        for which, look in LOOKS.items():
            yield found, which, {**look, "label": f"{channel}, {WORDS[which]}", "marker": marker, "markersize": 3}


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
    for by_landmark, which, look in _series(nis_by_landmark):
        axes.plot(_column(by_landmark.values(), which), linestyle="none", **look)
    first = [*next(iter(nis_by_landmark.values())).values()]
    lows, highs = _column(first, "low"), _column(first, "high")
    axes.fill_between(range(len(first)), lows, highs, step="mid", color=MARK_COLOR, alpha=0.25, linewidth=0)
    axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.5)
    axes.set(xlabel="landmarks in the order of ids", ylabel="NIS per row (grey: 95 %)", title="by landmark")
    logarithmic(axes, "y")
    axes.set_xticks([])


def _column(rows: Iterable[dict[str, Any]], key: str) -> Float:
    """Return the value of `key` in each row, NaN for None."""
    return np.array([row[key] for row in rows], dtype=np.float64)


def _draw_quantiles(axes: Axes, quantiles: dict[str, Any]) -> None:
    """Draw quantiles of the normal scores against those of the normal distribution."""
    for found, which, look in _series(quantiles):
        axes.plot(found["normal"], found[which], linestyle="none", **look)
    reach = max(map(abs, axes.get_xlim()))
    axes.plot([-reach, reach], [-reach, reach], color=TRUTH_COLOR, linewidth=0.5)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -3 * reach), min(high, 3 * reach))
    axes.set(xlabel="quantile of the normal distribution", ylabel="normal score", title="distribution")


def _draw_whiteness(axes: Axes, autocorrelation: dict[str, Any]) -> None:
    """Draw the autocorrelation of normal scores against the lag, in observations of the same landmark."""
    for found, which, look in _series(autocorrelation):
        axes.plot(np.arange(1, len(found[which]) + 1), found[which], linewidth=0.8, **look)
    band = max(found["band"] for found in autocorrelation.values())
    axes.axhspan(-band, band, color=MARK_COLOR, alpha=0.25, linewidth=0)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -LEAST_CORRELATION), max(high, LEAST_CORRELATION))
    axes.set(xlabel="lag [observations of a landmark]", ylabel="correlation (grey: white, 95 %)", title="whiteness")
