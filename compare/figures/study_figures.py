"""Figures of a study: consistency over time, errors with 3-sigma bounds, ratios to the optimum."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, HINDSIGHT
from slamgauge.compare.figures.plot_style import (
    DIVERGED,
    DIVERGED_LOG,
    MARK_COLOR,
    band,
    curve,
    exceeding,
    legend_below,
    logarithmic,
    printed,
    robust_limits,
    sheet,
    styles,
    three_sigma,
)
from slamgauge.compare.scoring.optimum_notes import MARK, doubt_in_runs, misfits
from slamgauge.compare.scoring.runs import BAND_LEVEL, PerStep, Runs, paired
from slamgauge.compare.storage.staged_folder import Drawing
from slamgauge.compare.studies.summary import Summary, is_marked_against, misfit_optima, share_in_doubt

USUAL = 0.99  # share of the errors inside the limits; a diverged run may exceed them
RUNS_DRAWN = 50  # error curves; more are not distinguishable
COMPONENTS = (("x [m]", "x", 1.0), ("y [m]", "y", 1.0), ("heading [°]", "heading", 180.0 / np.pi))


def study_drawings(summary: Summary, runs: Mapping[str, Runs], step: float) -> dict[str, Drawing]:
    """Return functions that draw nees, nis, rmse, errors and ratios (.png, .svg); `step` is the time step [s]."""
    ran = {name: each for name, each in runs.items() if len(each.run)}
    title = f"{summary.scenario}, {summary.runs} runs"
    doubts = (misfits(misfit_optima(summary)), doubt_in_runs(CAUSAL, share_in_doubt(summary)))
    doubted_title = "\n".join(filter(None, (title, *doubts)))
    doubtful = {name for name in (CAUSAL, HINDSIGHT) if is_marked_against(summary, name)}
    nees, nis = "mean pose NEES (3 when consistent)", "NIS / degrees of freedom (1 when right)"
    return {
        "nees": lambda out: _draw_against_band(out / "nees", title, ran, step, Runs.nees_per_step, nees, is_log=True),
        "nis": lambda out: _draw_against_band(out / "nis", title, ran, step, Runs.nis_per_step, nis),
        "rmse": lambda out: _draw_rmse(out / "rmse", title, ran, step),
        "errors": lambda out: _draw_errors(out / "errors", title, ran, step),
        "ratios": lambda out: _draw_ratios(out / "ratios", doubted_title, ran, doubtful),
    }


def _draw_against_band(
    path: Path,
    title: str,
    runs: Mapping[str, Runs],
    step: float,
    statistic: Callable[[Runs], PerStep],
    label: str,
    *,
    is_log: bool = False,
) -> None:
    """Draw a curve for each estimator that has the statistic, and the widest of their chi-square bands."""
    found = {name: statistic(each) for name, each in runs.items()}
    found = {name: each for name, each in found.items() if not np.isnan(each.value).all()}
    if not found:
        return
    with printed(path, 3.2, title) as figure:
        axes = figure.subplots()
        low = np.fmin.reduce([each.low for each in found.values()])
        high = np.fmax.reduce([each.high for each in found.values()])
        band(axes, step * np.arange(len(low)), low, high, f"{BAND_LEVEL:.1%} band")
        height = _draw_curves(axes, found, runs, step, DIVERGED_LOG if is_log else DIVERGED)
        axes.set(ylabel=label, yscale="log" if is_log else "linear")
        if height is not None:
            axes.set_ylim(top=1.3 * max(height, np.nanmax(high)))
        if is_log:
            logarithmic(axes, "y")
        legend_below(figure, axes.get_legend_handles_labels()[0])


def _draw_rmse(path: Path, title: str, runs: Mapping[str, Runs], step: float) -> None:
    """Draw the RMS position error over runs against time with its 95 % interval; bounds are the smallest errors."""
    if not runs:
        return
    with printed(path, 3.2, title) as figure:
        axes = figure.subplots()
        found = {name: each.rmse_per_step() for name, each in runs.items()}
        height = _draw_curves(axes, found, runs, step)
        for name, style in styles(runs).items():
            time = step * np.arange(len(found[name].value))
            band(axes, time, found[name].low, found[name].high, color=style.color)
        axes.set(ylabel="RMS position error, 95 % band [m]", ylim=(0.0, None if height is None else 1.1 * height))
        legend_below(figure, axes.get_legend_handles_labels()[0])


def _draw_curves(
    axes: Axes, found: Mapping[str, PerStep], runs: Mapping[str, Runs], step: float, factor: float = DIVERGED
) -> float | None:
    """Draw curves against time in the styles of all `runs`; return their height without diverged ones, if any."""
    for name, style in styles(runs).items():
        if name in found:
            curve(axes, step * np.arange(len(found[name].value)), found[name].value, style, name)
    peaks = {name: np.array([np.nanmax(each.value)]) for name, each in found.items()}
    heights, diverged = robust_limits(peaks, factor)
    axes.set(xlabel="time [s]", title=exceeding(diverged))
    return heights[0] if diverged else None


def _draw_errors(path: Path, title: str, runs: Mapping[str, Runs], step: float) -> None:
    """Draw errors of single runs, and the mean over runs of the 3-sigma bounds."""
    runs = {name: each for name, each in runs.items() if name not in BOUNDS}
    if not runs:
        return
    extents: dict[str, Float] = {}
    with printed(path, 1.0 + 1.4 * len(runs), title) as figure:
        grid = figure.subplots(len(runs), 3, sharex=True, sharey="col", squeeze=False)
        for row, (name, style) in zip(grid, styles(runs).items(), strict=True):
            extents[name] = np.zeros(len(COMPONENTS))
            for place, (axes, (_, key, unit)) in enumerate(zip(row, COMPONENTS, strict=True)):
                errors = unit * runs[name].series[f"error_{key}"]
                sigma = unit * runs[name].series[f"sigma_{key}"].mean(axis=0)
                time = step * np.arange(len(sigma))
                lines = [np.column_stack([time, error]) for error in errors[:RUNS_DRAWN]]
                axes.add_collection(
                    LineCollection(lines, colors=MARK_COLOR, linewidths=0.3, alpha=0.5, rasterized=True)
                )
                three_sigma(axes, time, sigma, style, filled=True)
                axes.locator_params(nbins=3 if sheet().is_narrow else 5)
                usual = np.nanquantile(np.abs(errors), USUAL) if np.isfinite(errors).any() else 0.0
                extents[name][place] = np.nanmax([usual, 3.0 * np.nanmax(sigma, initial=0.0)])
            row[0].set_ylabel(name)
        heights, diverged = robust_limits(extents)
        for axes, height, (heading, _, _) in zip(grid[0], heights, COMPONENTS, strict=True):
            axes.set(title=heading, ylim=(-1.1 * height or -1.0, 1.1 * height or 1.0))
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        if diverged:
            grid[0][1].set_title(f"{exceeding(diverged)}\n{COMPONENTS[1][0]}")
        is_all = max(len(each.run) for each in runs.values()) <= RUNS_DRAWN
        whose = "error of each run" if is_all else f"errors of the first {RUNS_DRAWN} runs"
        figure.supylabel(f"{whose} (grey), mean 3σ bound (filled)", fontsize=7.5)


def _draw_ratios(path: Path, title: str, runs: Mapping[str, Runs], doubtful: Collection[str]) -> None:
    """Draw box plots of the ATE of each run divided by that of the optimum; `doubtful` optima are marked."""
    known = ((CAUSAL, "causal"), (HINDSIGHT, "hindsight"))
    references = [(name, f"{text}{MARK * (name in doubtful)}") for name, text in known if name in runs]
    boxes = [
        (f"{name} / {text}", _run_ratios(runs[name], runs[reference]), style.color)
        for reference, text in references
        for name, style in styles(runs).items()
        if name != reference
    ]
    boxes = [box for box in reversed(boxes) if len(box[1])]  # the first box is at the top
    if not boxes:
        return
    labels, ratios, colors = zip(*boxes, strict=True)
    with printed(path, 0.9 + 0.28 * len(boxes), title) as figure:
        axes = figure.subplots()
        small = {"markersize": 2}
        drawn = axes.boxplot(ratios, tick_labels=labels, orientation="horizontal", flierprops=small)
        for median, color in zip(drawn["medians"], colors, strict=True):
            median.set(color=color, linewidth=1.5)
        axes.axvline(1.0, color=MARK_COLOR, linewidth=0.6)
        extents = {label: each.max(keepdims=True) for label, each, _ in boxes}
        heights, diverged = robust_limits(extents, DIVERGED_LOG)
        axes.set(xlabel="ATE / optimum's ATE, run by run", title=exceeding(diverged), xscale="log")
        if diverged:
            axes.set_xlim(right=1.3 * heights[0])
        logarithmic(axes, "x")


def _run_ratios(runs: Runs, optimum: Runs) -> Float:
    ours, theirs = paired(runs, optimum)
    ratios = runs.figures["ate_m"][ours] / optimum.figures["ate_m"][theirs]
    return ratios[np.isfinite(ratios)]
