"""Figures of a study: consistency over time, errors with 3-sigma bounds, ratios to the optimum."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, HINDSIGHT
from slamgauge.compare.figures.axis_limits import DIVERGED, DIVERGED_LOG, exceeding, robust_limits
from slamgauge.compare.figures.downsampling import extreme_rows
from slamgauge.compare.figures.figure_size import save_printed, sheet
from slamgauge.compare.figures.plot_style import LEGEND, MARK_COLOR, PRINT, WRAPPED, logarithmic, styles
from slamgauge.compare.scoring.aggregation import BAND_LEVEL, PerStep, nees_per_step, nis_per_step, rmse_per_step
from slamgauge.compare.scoring.optimum_notes import MARK, doubt_in_runs, misfits
from slamgauge.compare.scoring.runs import Runs, paired
from slamgauge.compare.storage.best_effort import Drawing
from slamgauge.compare.storage.safe_names import math_text
from slamgauge.compare.studies.summary import Summary, is_marked_against, misfit_optima, share_in_doubt

USUAL = 0.99  # share of the errors inside the limits; a diverged run may exceed them
RUNS_DRAWN = 50  # error curves; more are not distinguishable
MOST_POINTS = 24_000  # points of all error curves; half a megabyte of SVG
FEWEST_POINTS = 100  # points of a curve; if necessary fewer runs are drawn
COMPONENTS = (("x [m]", "x", 1.0), ("y [m]", "y", 1.0), ("heading [°]", "heading", 180.0 / np.pi))


def study_drawings(summary: Summary, runs: Mapping[str, Runs], step: float) -> dict[str, Drawing]:
    """Return functions that draw nees, nis, rmse, errors and ratios (.png, .svg); `step` is the time step [s]."""
    ran = {name: each for name, each in runs.items() if len(each.run)}
    title = f"{summary.scenario}, {summary.runs} runs"
    doubts = (misfits(misfit_optima(summary)), doubt_in_runs(CAUSAL, share_in_doubt(summary)))
    doubtful = {name for name in (CAUSAL, HINDSIGHT) if is_marked_against(summary, name)}
    return {
        "nees": lambda out: _save(out / "nees", lambda: _nees(ran, step), title),
        "nis": lambda out: _save(out / "nis", lambda: _nis(ran, step), title),
        "rmse": lambda out: _save(out / "rmse", lambda: _rmse(ran, step), title),
        "errors": lambda out: _save(out / "errors", lambda: _errors(ran, step), title),
        "ratios": lambda out: _save(out / "ratios", lambda: _ratios(ran, doubtful), title, *doubts),
    }


def _save(path: Path, draw: Callable[[], Figure | None], *title: str | None) -> None:
    """Write a figure with the given lines of title; nothing if `draw` returns None."""
    with mpl.rc_context(PRINT):
        figure = draw()
        if figure is not None:
            figure.suptitle(math_text("\n".join(filter(None, title))), **WRAPPED)
            save_printed(figure, path)


def _nees(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Draw the mean pose NEES over runs against time, with its chi-square band."""
    return _against_band(runs, nees_per_step, step, "mean pose NEES (3 when consistent)", is_log=True)


def _nis(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Draw NIS over degrees of freedom, of all runs together, against time, with its chi-square band."""
    return _against_band(runs, nis_per_step, step, "NIS / degrees of freedom (1 when right)")


def _against_band(
    runs: Mapping[str, Runs], statistic: Callable[[Runs], PerStep], step: float, label: str, *, is_log: bool = False
) -> Figure | None:
    """Draw a curve for each estimator that has the statistic, and the widest of their bands.

    The axis is logarithmic if `is_log`. Its limits ignore diverged estimators.
    """
    curves = {name: statistic(each) for name, each in runs.items()}
    curves = {name: curve for name, curve in curves.items() if not np.isnan(curve.value).all()}
    if not curves:
        return None
    figure = Figure(figsize=(sheet().inches, 3.2), layout="constrained")
    axes = figure.subplots()
    time = step * np.arange(len(next(iter(curves.values())).value))
    low = np.fmin.reduce([curve.low for curve in curves.values()])
    high = np.fmax.reduce([curve.high for curve in curves.values()])
    axes.fill_between(time, low, high, color=MARK_COLOR, alpha=0.25, linewidth=0, label=f"{BAND_LEVEL:.1%} band")
    for name, style in styles(runs).items():
        if name in curves:
            value = curves[name].value
            axes.plot(time, value, color=style.color, linestyle=style.dashes, linewidth=0.9, label=name)
    peaks = {name: np.array([np.nanmax(each.value)]) for name, each in curves.items()}
    heights, diverged = robust_limits(peaks, DIVERGED_LOG if is_log else DIVERGED)
    axes.set(xlabel="time [s]", ylabel=label, title=exceeding(diverged), yscale="log" if is_log else "linear")
    if diverged:
        axes.set_ylim(top=1.3 * max(heights[0], np.nanmax(high)))
    if is_log:
        logarithmic(axes, "y")
    figure.legend(loc="outside lower center", ncols=sheet().legend_columns(len(curves) + 1), **LEGEND)
    return figure


def _rmse(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Draw the RMS position error over runs against time; bounds are the smallest possible errors."""
    if not runs:
        return None
    figure = Figure(figsize=(sheet().inches, 3.2), layout="constrained")
    axes = figure.subplots()
    curves = {name: rmse_per_step(each) for name, each in runs.items()}
    for name, style in styles(runs).items():
        time = step * np.arange(len(curves[name]))
        axes.plot(time, curves[name], color=style.color, linestyle=style.dashes, linewidth=0.9, label=name)
    heights, diverged = robust_limits({name: np.array([np.nanmax(each)]) for name, each in curves.items()})
    top = 1.1 * heights[0] if diverged else None
    label = "RMS position error over runs [m]"
    axes.set(xlabel="time [s]", ylabel=label, ylim=(0.0, top), title=exceeding(diverged))
    figure.legend(loc="outside lower center", ncols=sheet().legend_columns(len(curves)), **LEGEND)
    return figure


def _errors(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Draw errors of single runs, and the mean over runs of the 3-sigma bounds."""
    runs = {name: each for name, each in runs.items() if name not in BOUNDS}
    if not runs:
        return None
    figure = Figure(figsize=(sheet().inches, 1.0 + 1.4 * len(runs)), layout="constrained")
    grid = figure.subplots(len(runs), 3, sharex=True, sharey="col", squeeze=False)
    for axes, (title, _, _) in zip(grid[0], COMPONENTS, strict=True):
        axes.set_title(title)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    extents: dict[str, Float] = {}
    panels, available = grid.size, max(len(each.run) for each in runs.values())
    drawn = min(available, RUNS_DRAWN, max(MOST_POINTS // (FEWEST_POINTS * panels), 1))
    for row, (name, style) in zip(grid, styles(runs).items(), strict=True):
        for axes, (_, key, unit) in zip(row, COMPONENTS, strict=True):
            errors, sigmas = runs[name].series[f"error_{key}"], runs[name].series[f"sigma_{key}"]
            time = step * np.arange(errors.shape[1])
            for error in errors[:drawn]:
                rows = extreme_rows(error, MOST_POINTS // (drawn * panels))
                axes.plot(time[rows], unit * error[rows], color=MARK_COLOR, linewidth=0.3, alpha=0.5)
            bound = 3 * unit * sigmas.mean(axis=0)
            for side in (-bound, bound):
                axes.plot(time, side, color=style.color, linestyle=style.dashes, linewidth=1.2)
            axes.locator_params(nbins=3 if sheet().is_narrow else 5)
        row[0].set_ylabel(name)
        extents[name] = np.array([_extent(runs[name], key, unit) for _, key, unit in COMPONENTS])
    heights, diverged = robust_limits(extents)
    for axes, height in zip(grid[0], heights, strict=True):
        axes.set_ylim(-1.1 * height or -1.0, 1.1 * height or 1.0)
    if diverged:
        grid[0][1].set_title(f"{exceeding(diverged)}\n{COMPONENTS[1][0]}")
    whose = "error of each run" if drawn == available else f"errors of the first {drawn} runs"
    figure.supylabel(f"{whose} (grey), mean 3σ bound (dashed)", fontsize=7.5)
    return figure


def _extent(runs: Runs, key: str, unit: float) -> float:
    """Return the height of a panel that contains the bounds and nearly all errors."""
    errors, sigmas = runs.series[f"error_{key}"], runs.series[f"sigma_{key}"]
    usual = np.nanquantile(np.abs(errors), USUAL) if np.isfinite(errors).any() else 0.0
    return unit * float(np.nanmax([usual, 3 * np.nanmax(sigmas.mean(axis=0), initial=0.0)]))


def _ratios(runs: Mapping[str, Runs], doubtful: Collection[str]) -> Figure | None:
    """Draw box plots of the ATE of each run divided by that of the optimum; `doubtful` optima are marked."""
    known = ((CAUSAL, "causal"), (HINDSIGHT, "hindsight"))
    references = [(name, f"{text}{MARK * (name in doubtful)}") for name, text in known if name in runs]
    boxes = [
        (f"{name} / {text}", _run_ratios(runs[name], runs[reference]), styles(runs)[name].color)
        for reference, text in references
        for name in runs
        if name != reference
    ]
    boxes = [box for box in boxes if len(box[1])]
    if not boxes:
        return None
    boxes.reverse()  # the first box is at the top
    figure = Figure(figsize=(sheet().inches, 0.9 + 0.28 * len(boxes)), layout="constrained")
    axes = figure.subplots()
    drawn = axes.boxplot(
        [ratios for _, ratios, _ in boxes],
        tick_labels=[label for label, _, _ in boxes],
        orientation="horizontal",
        flierprops={"markersize": 2},
    )
    for median, (_, _, color) in zip(drawn["medians"], boxes, strict=True):
        median.set(color=color, linewidth=1.5)
    axes.axvline(1.0, color=MARK_COLOR, linewidth=0.6)
    heights, diverged = robust_limits({label: ratios.max(keepdims=True) for label, ratios, _ in boxes}, DIVERGED_LOG)
    axes.set(xlabel="ATE / optimum's ATE, run by run", title=exceeding(diverged), xscale="log")
    if diverged:
        axes.set_xlim(right=1.3 * heights[0])
    logarithmic(axes, "x")
    return figure


def _run_ratios(runs: Runs, optimum: Runs) -> Float:
    ours, theirs = paired(runs, optimum)
    ratios = runs.figures["ate_m"][ours] / optimum.figures["ate_m"][theirs]
    return ratios[np.isfinite(ratios)]
