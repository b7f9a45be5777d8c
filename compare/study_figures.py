"""The figures of a study: consistency over time, errors in their 3-sigma envelope, ratios to the optimum."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compare.consistency import chi2_band
from compare.plot_style import LEGEND, MARK_COLOR, PRINT, Style, save, styles
from compare.study_store import Runs
from compare.study_summary import BAND_LEVEL, Summary, nees_per_step
from slam2d import Float

RUNS_DRAWN = 50  # error curves; more are one grey mass
COMPONENTS = (("x", "error_x", "sigma_x", 1.0), ("y", "error_y", "sigma_y", 1.0))
HEADING = ("heading", "error_heading", "sigma_heading", 180.0 / np.pi)


def save_study_figures(out: Path, summary: Summary, runs: Mapping[str, Runs], step: float) -> None:
    """Write nees, nis, errors and ratios (.png and .svg) into `out`; `step` is the time step [s]."""
    ran = {name: each for name, each in runs.items() if len(each.run)}
    title = f"{summary.scenario}, {summary.runs} runs"
    with mpl.rc_context(PRINT):
        for name, draw in (("nees", _nees), ("nis", _nis), ("errors", _errors), ("ratios", _ratios)):
            figure = draw(ran, step)
            if figure is not None:
                figure.suptitle(title)
                save(figure, out / name)


def _nees(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Mean pose NEES over runs against time, with its chi-square band."""
    shown = {name: each for name, each in runs.items() if not np.isnan(each.series["nees_pose"]).all()}
    if not shown:
        return None
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for name, style in styles(runs).items():
        if name not in shown:
            continue
        average, low, high = nees_per_step(shown[name])
        time = step * np.arange(len(average))
        _line(axes, time, average, style, name)
    axes.fill_between(time, low, high, color=MARK_COLOR, alpha=0.25, linewidth=0, label=f"{BAND_LEVEL:.1%} band")
    axes.set(yscale="log", xlabel="time [s]", ylabel="mean pose NEES (3 when consistent)")
    figure.legend(loc="outside lower center", ncols=6, **LEGEND)
    return figure


def _nis(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """NIS over its degrees of freedom, all runs together, against time, with its chi-square band."""
    shown = {name: each for name, each in runs.items() if np.nansum(each.series["nis_dof"]) > 0}
    if not shown:
        return None
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for name, style in styles(runs).items():
        if name not in shown:
            continue
        dof = shown[name].series["nis_dof"].sum(axis=0)
        seen = dof > 0
        time, dof = step * np.flatnonzero(seen), dof[seen]
        _line(axes, time, shown[name].series["nis"].sum(axis=0)[seen] / dof, style, name)
    bands = {each: chi2_band(BAND_LEVEL, each) for each in np.unique(dof).tolist()}
    low, high = np.array([bands[each] for each in dof.tolist()]).T / dof
    axes.fill_between(time, low, high, color=MARK_COLOR, alpha=0.25, linewidth=0, label=f"{BAND_LEVEL:.1%} band")
    axes.set(xlabel="time [s]", ylabel="NIS / degrees of freedom (1 when right)")
    figure.legend(loc="outside lower center", ncols=6, **LEGEND)
    return figure


def _errors(runs: Mapping[str, Runs], step: float) -> Figure | None:
    """Errors of single runs, and three times the sigma that the estimator claims, mean over runs."""
    if not runs:
        return None
    figure = Figure(figsize=(7.2, 1.0 + 1.4 * len(runs)), layout="constrained")
    grid = figure.subplots(len(runs), 3, sharex=True, sharey="col", squeeze=False)
    for row, (name, style) in zip(grid, styles(runs).items(), strict=True):
        for axes, (component, error, sigma, unit) in zip(row, (*COMPONENTS, HEADING), strict=True):
            series = runs[name].series
            time = step * np.arange(series[error].shape[1])
            axes.plot(time, unit * series[error][:RUNS_DRAWN].T, color=MARK_COLOR, linewidth=0.3, alpha=0.5)
            bound = 3 * unit * series[sigma].mean(axis=0)
            for side in (-bound, bound):
                axes.plot(time, side, color=style.color, linestyle=style.dashes, linewidth=1.2)
            if row is grid[0]:
                axes.set_title(f"{component} [{'°' if component == 'heading' else 'm'}]")
            if row is grid[-1]:
                axes.set_xlabel("time [s]")
        row[0].set_ylabel(name)
    figure.supylabel(r"error of each run (grey), mean 3$\sigma$ bound (dashed)", fontsize=7.5)
    return figure


def _ratios(runs: Mapping[str, Runs], step: float) -> Figure | None:  # noqa: ARG001 drawn like the others
    """ATE of each run over that of the optimum in the same run: box plots."""
    references = [(name, text) for name, text in (("isam2", "causal"), ("batch", "hindsight")) if name in runs]
    boxes = [
        (f"{name}\n/ {text}", _run_ratios(runs[name], runs[reference]), styles(runs)[name].color)
        for reference, text in references
        for name in runs
        if name != reference
    ]
    boxes = [box for box in boxes if len(box[1])]
    if not boxes:
        return None
    figure = Figure(figsize=(1.0 + 0.8 * len(boxes), 3.2), layout="constrained")
    axes = figure.subplots()
    drawn = axes.boxplot(
        [ratios for _, ratios, _ in boxes], tick_labels=[label for label, _, _ in boxes], flierprops={"markersize": 2}
    )
    for median, (_, _, color) in zip(drawn["medians"], boxes, strict=True):
        median.set(color=color, linewidth=1.5)
    axes.axhline(1.0, color=MARK_COLOR, linewidth=0.6)
    axes.set(yscale="log", ylabel="ATE / optimum's ATE, run by run")
    return figure


def _run_ratios(runs: Runs, optimum: Runs) -> Float:
    _, ours, theirs = np.intersect1d(runs.run, optimum.run, assume_unique=True, return_indices=True)
    ratios = runs.figures["ate_m"][ours] / optimum.figures["ate_m"][theirs]
    return ratios[np.isfinite(ratios)]


def _line(axes: Axes, time: Float, values: Float, style: Style, label: str) -> None:
    axes.plot(time, values, color=style.color, linestyle=style.dashes, linewidth=0.9, label=label)
