"""Figure of a sweep: error, consistency, reported sigma and map size against the value of the key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, REGISTRY, is_optimum
from slamgauge.compare.figures.axes import logarithmic
from slamgauge.compare.figures.plot_style import MARK_COLOR, TRUTH_COLOR, Style, legend_below, printed, sheet, styles
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import at_places
from slamgauge.compare.studies.sweep import Sweep, shares_in_doubt

PANELS = (
    ("ate_m", "ATE [m]"),
    ("nees_pose_per_dof", "pose NEES / 3 (1 when consistent)"),
    ("position_sigma_m", "reported position sigma [m]"),
    ("landmarks_mapped", "landmarks mapped"),
)
WIDE = 4.0  # values that span more than this factor get a logarithmic axis


def save_sweep_figure(out: Path, sweep: Sweep) -> None:
    """Write sweep.png and sweep.svg into `out`."""
    rows, columns, height = (4, 1, 8.0) if sheet().is_narrow else (2, 2, 5.0)
    title = f"{sweep.scenario}, {sweep.runs} runs at each value (bars: 95 % intervals)"
    title = "\n".join([title, *at_places(CAUSAL, shares_in_doubt(sweep), then="")])
    places = _places(sweep.values)
    with printed(out / "sweep", height, title) as figure:
        for axes, (key, label) in zip(figure.subplots(rows, columns, sharex=True).flat, PANELS, strict=True):
            means = [
                _draw(axes, places, [summary.estimators[name][key] for summary in sweep.summaries], name, style)
                for name, style in styles(sweep.summaries[0].estimators).items()
            ]
            _arrange(axes, np.concatenate(means))
            axes.set_ylabel(label)
            if key == "nees_pose_per_dof":
                axes.axhline(1.0, color=MARK_COLOR, linewidth=0.6)
        if _is_wide(places):
            axes.set_xscale("log")
        axes.set_xticks(places, sweep.values)
        axes.minorticks_off()
        for axes in figure.axes[-columns:]:
            axes.set_xlabel(sweep.key)
        legend_below(figure, figure.axes[0].get_legend_handles_labels()[0])


def _draw(axes: Axes, places: Float, intervals: list[Interval | None], name: str, style: Style) -> Float:
    """Draw means with their intervals, of optima and bounds as lines without markers; return the means."""
    found = [(place, each) for place, each in zip(places, intervals, strict=True) if each is not None]
    if not found:
        return np.zeros(0)
    at = np.array([place for place, _ in found])
    mean = np.array([each.mean for _, each in found])
    low = np.array([each.mean if each.low is None else each.low for _, each in found])
    high = np.array([each.mean if each.high is None else each.high for _, each in found])
    is_line = is_optimum(name) or name in BOUNDS
    axes.errorbar(
        at,
        mean,
        yerr=np.abs([mean - low, high - mean]),
        color=TRUTH_COLOR if is_line else style.color,
        linestyle=style.dashes,
        linewidth=0.9,
        marker="" if is_line else "o",
        markersize=2.5,
        capsize=2,
        label=REGISTRY[name].title if is_optimum(name) else name,
    )
    return mean


def _places(values: tuple[str, ...]) -> Float:
    """Return the values as numbers, or their positions in the list if one is not a number."""
    try:
        return np.array([float(value) for value in values])
    except ValueError:
        return np.arange(len(values), dtype=np.float64)


def _is_wide(values: Float) -> bool:
    return bool(values.size and values.min() > 0 and values.max() > WIDE * values.min())


def _arrange(axes: Axes, means: Float) -> None:
    """Make the vertical axis logarithmic if the range of the means is large."""
    if _is_wide(means):
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(means.min() / 2, None)
        logarithmic(axes, "y")
