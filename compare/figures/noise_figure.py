"""The figure of `slamgauge noise`: sigmas, NIS by landmark, quantiles and whiteness, as assumed and as found."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import ndtri

from slamgauge.compare.figures.plot_style import LEGEND, MARK_COLOR, PRINT, TRUTH_COLOR, logarithmic
from slamgauge.compare.figures.sheet import INCHES, save_printed
from slamgauge.compare.noise.diagnosis import Diagnosis
from slamgauge.compare.noise.finding import Noise
from slamgauge.compare.noise.words import verdict

BEFORE, AFTER = "#EE7733", "#0077BB"
MARKERS = ("o", "^")  # of channels
SHOWN = 20.0  # largest factor between what is found and assumed
MANY = 400  # points of a quantile plot
LEAST_CORRELATION = 0.1  # that the axis shows


class Series(NamedTuple):
    """The scores of a channel, as assumed or as found, and how they are drawn."""

    channel: str
    diagnosis: Diagnosis
    look: dict[str, Any]


def save_noise_figure(out: Path, noise: Noise) -> None:
    """Write noise.png and noise.svg into `out`."""
    with mpl.rc_context(PRINT):
        figure = Figure(figsize=(INCHES["page"], 5.4), layout="constrained")
        (sigmas, nis), (quantiles, whiteness) = figure.subplots(2, 2)
        _draw_sigmas(sigmas, noise)
        _draw_nis(nis, noise)
        _draw_quantiles(quantiles, noise)
        _draw_whiteness(whiteness, noise)
        handles, labels = quantiles.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), **LEGEND)
        save_printed(figure, out / "noise")


def _series(noise: Noise) -> Iterator[Series]:
    for channel, marker in zip(noise.after.scores, MARKERS, strict=False):
        before: dict[str, Any] = {"color": BEFORE, "fillstyle": "none", "label": f"{channel}, assumed"}
        after: dict[str, Any] = {"color": AFTER, "fillstyle": "full", "label": f"{channel}, found"}
        yield Series(channel, noise.before, before | {"marker": marker, "markersize": 3})
        yield Series(channel, noise.after, after | {"marker": marker, "markersize": 3})


def _draw_sigmas(axes: Axes, noise: Noise) -> None:
    """Sigmas found, with their intervals, over those assumed; over the interval's end where none is assumed."""
    for place, (name, found) in enumerate(noise.parameters.items()):
        end = found.high if np.isfinite(found.high) else found.value
        over = noise.assumed[name] or end
        low, high = max(found.low / over, 1 / SHOWN), min(found.high / over, SHOWN)
        axes.plot([low, high], [place, place], color=AFTER, linewidth=1.5)
        if found.low > 0.0:
            axes.plot(found.value / over, place, "o", color=AFTER, markersize=4)
        text = f"{found.value:.3g}: {verdict(found, noise.assumed[name])}" if found.low > 0.0 else verdict(found, 0.0)
        axes.text(0.03, place - 0.2, text, transform=axes.get_yaxis_transform(), fontsize=6)
    axes.axvline(1.0, color=BEFORE, linewidth=0.8, linestyle="--")
    axes.set_yticks(range(len(noise.parameters)), [*noise.parameters])
    axes.set_ylim(len(noise.parameters) - 0.5, -0.7)
    axes.set(xscale="log", xlabel="sigma found / assumed, 95 % interval", title="noise")
    low, high = axes.get_xlim()
    axes.set_xlim(min(max(low, 1 / SHOWN), 0.5), max(min(high, SHOWN), 2.0))
    logarithmic(axes, "x")
    axes.grid(visible=True, axis="x", which="major", linewidth=0.3)


def _draw_nis(axes: Axes, noise: Noise) -> None:
    """NIS of every landmark, in the order of ids."""
    for channel, diagnosis, look in _series(noise):
        means = [each.mean for each in diagnosis.nis_by_landmark[channel].values()]
        axes.plot(means, linestyle="none", **look)
    bands = [(each.low, each.high) for each in next(iter(noise.after.nis_by_landmark.values())).values()]
    lows, highs = zip(*bands, strict=True)
    axes.fill_between(range(len(bands)), lows, highs, step="mid", color=MARK_COLOR, alpha=0.25, linewidth=0)
    axes.axhline(1.0, color=TRUTH_COLOR, linewidth=0.5)
    axes.set(xlabel="landmarks in the order of ids", ylabel="NIS a row (grey: 95 %)", title="by landmark")
    logarithmic(axes, "y")
    axes.set_xticks([])


def _draw_quantiles(axes: Axes, noise: Noise) -> None:
    """Quantiles of the normal scores against those of the normal distribution."""
    for channel, diagnosis, look in _series(noise):
        scores = np.sort(diagnosis.scores[channel])
        expected = np.asarray(ndtri((np.arange(len(scores)) + 0.5) / len(scores)))
        shown = np.unique(np.searchsorted(expected, np.linspace(expected[0], expected[-1], MANY)))
        axes.plot(expected[shown], scores[shown], linestyle="none", **look)
    reach = max(map(abs, axes.get_xlim()))
    axes.plot([-reach, reach], [-reach, reach], color=TRUTH_COLOR, linewidth=0.5)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -3 * reach), min(high, 3 * reach))
    axes.set(xlabel="quantile of the normal distribution", ylabel="normal score", title="distribution")


def _draw_whiteness(axes: Axes, noise: Noise) -> None:
    """Correlation of a landmark's scores against how many sights lie between them."""
    for channel, diagnosis, look in _series(noise):
        found = diagnosis.correlation[channel]
        axes.plot(np.arange(1, len(found) + 1), found, linewidth=0.8, **look)
    band = max(noise.after.correlation_band.values())
    axes.axhspan(-band, band, color=MARK_COLOR, alpha=0.25, linewidth=0)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -LEAST_CORRELATION), max(high, LEAST_CORRELATION))
    axes.set(xlabel="sights of a landmark apart", ylabel="correlation (grey: white, 95 %)", title="whiteness")
