"""Figure of a sweep: error, consistency, reported sigma and map size against the value of the key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, REGISTRY, is_optimum
from slamgauge.compare.figures.axes import logarithmic
from slamgauge.compare.figures.plot_style import MARK_COLOR, TRUTH_COLOR, Style, legend_below, printed, sheet, styles
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import at_places, distance_in_runs
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
    title = "\n".join([title, *at_places(CAUSAL, shares_in_doubt(sweep), distance_in_runs)])
    with printed(out / "sweep", height, title) as figure:
        names = styles(sweep.summaries[0].estimators)
        for axes, (key, label) in zip(figure.subplots(rows, columns, sharex=True).flat, PANELS, strict=True):
            for name, style in names.items():
                intervals = [summary.estimators[name][key] for summary in sweep.summaries]
                title = REGISTRY[name].title if is_optimum(name) else name
                _draw(axes, sweep.values, intervals, title, style, line=is_optimum(name) or name in BOUNDS)
            axes.set_ylabel(label)
            _arrange(axes, sweep.values)
            if key == "nees_pose_per_dof":
                axes.axhline(1.0, color=MARK_COLOR, linewidth=0.6)
        for axes in figure.axes[-columns:]:
            axes.set_xlabel(sweep.key)
        legend_below(figure, figure.axes[0])


def _draw(
    axes: Axes, values: tuple[str, ...], intervals: list[Interval | None], label: str, style: Style, *, line: bool
) -> None:
    """Draw means with their intervals; optima and bounds as lines without markers."""
    pairs = zip(_places(values).tolist(), intervals, strict=True)
    found = sorted(((place, each) for place, each in pairs if each is not None), key=lambda pair: pair[0])
    if not found:
        return
    places, known = zip(*found, strict=True)
    mean = np.array([each.mean for each in known])
    low = np.array([each.mean if each.low is None else each.low for each in known])
    high = np.array([each.mean if each.high is None else each.high for each in known])
    axes.errorbar(
        places,
        mean,
        yerr=np.abs([mean - low, high - mean]),
        color=TRUTH_COLOR if line else style.color,
        linestyle=style.dashes,
        linewidth=0.9,
        marker="" if line else "o",
        markersize=2.5,
        capsize=2,
        label=label,
    )


def _places(values: tuple[str, ...]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the values as numbers, or their positions in the list if one is not a number."""
    try:
        return np.array([float(value) for value in values])
    except ValueError:
        return np.arange(len(values), dtype=np.float64)


def _arrange(axes: Axes, values: tuple[str, ...]) -> None:
    """Set ticks at the values; make axes logarithmic if the range is large."""
    places = _places(values)
    if places.min() > 0 and places.max() > WIDE * places.min():
        axes.set_xscale("log")
    axes.set_xticks(places, values)
    axes.minorticks_off()
    means = np.array([mean for line in axes.lines if line.get_marker() != "_" for mean in np.asarray(line.get_ydata())])
    if means.size and means.min() > 0 and means.max() > WIDE * means.min():
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(means.min() / 2, None)
        logarithmic(axes, "y")
