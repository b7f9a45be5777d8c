"""Figures of many runs: of a study, and of the settings of the exercise."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, HINDSIGHT
from slamgauge.compare.exercise.results import Closure, SettingResult
from slamgauge.compare.exercise.settings import EKF, GTSAM, Setting
from slamgauge.compare.figures.curves import band, curve, exceeding, logarithmic, robust_limits, three_sigma
from slamgauge.compare.figures.frames import RayStrip, has_rays
from slamgauge.compare.figures.plot_style import MARK_COLOR, SHEET, Sheet, legend_below, printed, printed_on, styles
from slamgauge.compare.figures.run_figures import HEIGHTS, draw_map_and_errors
from slamgauge.compare.scoring.optimum_notes import MARK, doubt_in_runs, misfits
from slamgauge.compare.scoring.runs import BAND_LEVEL, PerStep, Runs, paired
from slamgauge.compare.storage.files import Results
from slamgauge.compare.storage.staged_folder import Drawing
from slamgauge.compare.studies.summary import Summary, is_marked_against, misfit_optima, share_in_doubt
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

USUAL = 0.99  # share of the errors inside the limits; a diverged run may exceed them
RUNS_DRAWN = 50  # error curves; more are not distinguishable
COMPONENTS = (("x [m]", "x", 1.0), ("y [m]", "y", 1.0), ("heading [°]", "heading", 180.0 / np.pi))
PNG = Sheet(formats=("png",))
PANEL_HEIGHT, FOOT = 2.2, 0.9  # [in] of a row of panels, and of title and legend
BEFORE, AFTER = 0.35, 0.85  # opacities of the bars before and at a loop closure
BAR = 0.15  # width of a bar; a lap has the width 1
PLACES = {EKF: -0.25, CAUSAL: 0.1, GTSAM: 0.35}  # place of an estimator in a lap


def study_drawings(summary: Summary, runs: Mapping[str, Runs], step: float) -> dict[str, Drawing]:
    """Return functions that draw nees, nis, rmse, errors and ratios (.png, .svg); `step` is the time step [s]."""
    ran = {name: each for name, each in runs.items() if len(each.run)}
    title = f"{summary.scenario}, {summary.runs} runs"
    doubts = (misfits(misfit_optima(summary)), doubt_in_runs(CAUSAL, share_in_doubt(summary)))
    doubted_title = "\n".join(filter(None, (title, *doubts)))
    doubtful = {name for name in (CAUSAL, HINDSIGHT) if is_marked_against(summary, name)}

    def over_time(name: str, statistic: Callable[[Runs], PerStep], label: str) -> Drawing:
        return lambda out: _draw_over_time(out / name, title, ran, statistic, step, label)

    return {
        "nees": over_time("nees", Runs.nees_per_step, "mean pose NEES (3 when consistent)"),
        "nis": over_time("nis", Runs.nis_per_step, "NIS / degrees of freedom (1 when right)"),
        "rmse": over_time("rmse", Runs.rmse_per_step, "RMS position error, 95 % band [m]"),
        "errors": lambda out: _draw_errors(out / "errors", title, ran, step),
        "ratios": lambda out: _draw_ratios(out / "ratios", doubted_title, ran, doubtful),
    }


def _draw_over_time(
    path: Path, title: str, runs: Mapping[str, Runs], statistic: Callable[[Runs], PerStep], step: float, label: str
) -> None:
    """Draw a curve of the statistic for each estimator that has it.

    Errors have a 95 % band each, other statistics the widest of their chi-square bands; limits ignore diverged curves.
    """
    is_error, is_log = path.name == "rmse", path.name == "nees"
    every = {name: statistic(each) for name, each in runs.items()}
    found = {name: each for name, each in every.items() if np.isfinite(each.value).any()}
    if not found:
        return
    with printed(path, 3.2, title) as figure:
        axes = figure.subplots()
        extents = {name: np.array([np.nanmax(each.value)]) for name, each in found.items()}
        heights, diverged = robust_limits(extents, is_log=is_log)
        height = heights[0]
        if not is_error:
            low = np.fmin.reduce([each.low for each in found.values()])
            high = np.fmax.reduce([each.high for each in found.values()])
            height = max(height, np.nanmax(high))
            band(axes, step * np.arange(len(low)), low, high, f"{BAND_LEVEL:.1%} band")
        for name, style in styles(runs).items():
            if name in found:
                each = found[name]
                time = step * np.arange(len(each.value))
                curve(axes, time, each.value, style, name)
                if is_error:
                    band(axes, time, each.low, each.high, color=style.color)
        axes.set(xlabel="time [s]", ylabel=label, title=exceeding(diverged), yscale="log" if is_log else "linear")
        axes.set_ylim(bottom=0.0 if is_error else None, top=1.3 * height if diverged else None)
        if is_log:
            logarithmic(axes, "y")
        legend_below(figure, axes.get_legend_handles_labels()[0])


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
            for place, (_, key, unit) in enumerate(COMPONENTS):
                errors = unit * runs[name].series[f"error_{key}"]
                sigma = unit * runs[name].series[f"sigma_{key}"].mean(axis=0)
                time = step * np.arange(len(sigma))
                _draw_single_errors(row[place], time, errors)
                three_sigma(row[place], time, sigma, style, filled=True)
                extents[name][place] = _usual_extent(errors, sigma)
            row[0].set_ylabel(name)
        heights, diverged = robust_limits(extents)
        for axes, height, (heading, _, _) in zip(grid[0], heights, COMPONENTS, strict=True):
            limit = 1.1 * height or 1.0
            axes.set(title=heading, ylim=(-limit, limit))
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        if diverged:
            grid[0][1].set_title(f"{exceeding(diverged)}\n{COMPONENTS[1][0]}")
        is_all = max(len(each.run) for each in runs.values()) <= RUNS_DRAWN
        whose = "error of each run" if is_all else f"errors of the first {RUNS_DRAWN} runs"
        figure.supylabel(f"{whose} (grey), mean 3σ bound (filled)", fontsize=7.5)


def _draw_single_errors(axes: Axes, time: ArrayLike, errors: Float) -> None:
    """Draw a thin line for the errors of each of the first runs; `errors` has the shape (runs, N+1)."""
    lines = [np.column_stack([time, error]) for error in errors[:RUNS_DRAWN]]
    axes.add_collection(LineCollection(lines, colors=MARK_COLOR, linewidths=0.3, alpha=0.5, rasterized=True))
    axes.locator_params(nbins=3 if SHEET.get().is_narrow else 5)


def _usual_extent(errors: Float, sigma: Float) -> float:
    """Return the largest usual error or 3-sigma bound."""
    usual = np.nanquantile(np.abs(errors), USUAL) if np.isfinite(errors).any() else 0.0
    return np.nanmax([usual, 3.0 * np.nanmax(sigma, initial=0.0)])


def _draw_ratios(path: Path, title: str, runs: Mapping[str, Runs], doubtful: Collection[str]) -> None:
    """Draw box plots of the ATE of each run divided by that of the optimum; `doubtful` optima are marked."""
    known = ((CAUSAL, "causal"), (HINDSIGHT, "hindsight"))
    references = [(name, f"{text}{MARK * (name in doubtful)}") for name, text in known if name in runs]
    boxes: list[tuple[str, Float, str]] = []
    for reference, text in references:
        for name, style in styles(runs).items():
            if name == reference:
                continue
            ratios = _run_ratios(runs[name], runs[reference])
            if len(ratios):
                boxes.append((f"{name} / {text}", ratios, style.color))
    boxes.reverse()  # the first box is at the top
    if not boxes:
        return
    labels, ratios, colors = zip(*boxes, strict=True)
    with printed(path, 0.9 + 0.28 * len(boxes), title) as figure:
        axes = figure.subplots()
        drawn = axes.boxplot(ratios, tick_labels=labels, orientation="horizontal", flierprops={"markersize": 2})
        for median, color in zip(drawn["medians"], colors, strict=True):
            median.set(color=color, linewidth=1.5)
        axes.axvline(1.0, color=MARK_COLOR, linewidth=0.6)
        extents = {label: each.max(keepdims=True) for label, each, _ in boxes}
        heights, diverged = robust_limits(extents, is_log=True)
        axes.set(xlabel="ATE / optimum's ATE, run by run", title=exceeding(diverged), xscale="log")
        if diverged:
            axes.set_xlim(right=1.3 * heights[0])
        logarithmic(axes, "x")


def _run_ratios(runs: Runs, optimum: Runs) -> Float:
    ours, theirs = paired(runs, optimum)
    ratios = runs.figures["ate_m"][ours] / optimum.figures["ate_m"][theirs]
    return ratios[np.isfinite(ratios)]


def save_setting_figure(
    path: Path, truth: Truth, recording: Recording, estimates: Mapping[str, Estimate], title: str
) -> None:
    """Write a figure as PNG: map with truth, errors in their 3-sigma bounds, and rays of the EKF if it has any."""
    height = HEIGHTS["page"]
    with printed_on(PNG):
        if not has_rays(estimates[EKF]):
            with printed(path, height, title) as figure:
                draw_map_and_errors(figure, truth, recording, estimates)
            return
        strip = RayStrip(Results(title, truth, recording, dict(estimates)), EKF)
        with printed(path, height + strip.height, title) as figure:
            parts = figure.subfigures(2, 1, height_ratios=(height, strip.height))
            above, below = cast("Iterable[SubFigure]", parts)
            draw_map_and_errors(above, truth, recording, estimates)
            strip.draw(below)


def save_nees_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write the mean pose NEES over 3 of EKF and causal optimum against time as PNG, a panel for each setting."""
    with _panels(path, [each.setting for each in settings], title) as (figure, panels):
        for axes, ran in zip(panels, settings, strict=True):
            found = {name: Runs.nees_per_step(ran.study.loaded[name]) for name in (EKF, CAUSAL)}
            ekf = found[EKF]
            time = ran.scenario.trajectory.step * np.arange(len(ekf.value))
            band(axes, time, ekf.low / 3, ekf.high / 3, f"{BAND_LEVEL:.1%} band")
            for name, style in styles(found).items():
                curve(axes, time, found[name].value / 3, style, name)
            axes.set_xlabel("time [s]")
            logarithmic(axes, "y")
        figure.supylabel("mean pose NEES / 3 (1 when consistent)", fontsize=7.5)
        legend_below(figure, panels[0].get_legend_handles_labels()[0])


def save_closure_figure(path: Path, settings: Sequence[SettingResult], title: str) -> None:
    """Write errors and 3-sigma bounds just before and at the first loop closure of each lap as PNG.

    Settings without a loop closure have no panel; nothing is written if no setting has one.
    """
    closed = [each for each in settings if each.loop_closures]
    if not closed:
        return
    with _panels(path, [each.setting for each in closed], title) as (figure, panels):
        for axes, each in zip(panels, closed, strict=True):
            for closure in each.loop_closures:
                _draw_closure(axes, closure)
            laps = [closure.lap for closure in each.loop_closures]
            axes.set_xticks(laps, [f"lap {closure.lap}\n{closure.time_s:.0f} s" for closure in each.loop_closures])
            axes.set(xlim=(min(laps) - 0.5, max(laps) + 0.5), ylim=(0.0, None))
        figure.supylabel("position [m]", fontsize=7.5)
        handles, labels = panels[0].get_legend_handles_labels()
        labelled = dict(zip(labels, handles, strict=True))  # each label once
        figure.legend(handles=[*labelled.values()], loc="outside lower center", ncols=4)


def _draw_closure(axes: Axes, closure: Closure) -> None:
    """Draw bars of 3 sigma before and at the closure, with dots at the errors; of GTSAM batch the error only."""
    for name, style in styles(PLACES).items():
        found = closure.estimators[name]
        center = closure.lap + PLACES[name]
        errors, bounds = np.array([found["error_m"], found["three_sigma_m"]], dtype=np.float64)
        if name == GTSAM:
            places, errors = np.array([center]), errors[1:]
        else:
            places = center + BAR * np.array([-0.5, 0.5])
            moments = (("before", BEFORE), ("at the closure", AFTER))
            for place, bound, (when, opacity) in zip(places, bounds, moments, strict=True):
                axes.bar(place, bound, 0.9 * BAR, color=style.color, alpha=opacity, label=f"3σ of {name} {when}")
        (dots,) = axes.plot(places, errors, "D" if name == GTSAM else "o", color="w", markersize=4.5)
        dots.set(markeredgecolor=style.color, markeredgewidth=1.2, label=f"RMS error of {name}")


@contextmanager
def _panels(path: Path, settings: Sequence[Setting], title: str) -> Generator[tuple[Figure, list[Axes]]]:
    """Yield a figure, which is written as PNG at the end, with a panel for each setting."""
    count = len(settings)
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    with printed_on(PNG), printed(path, rows * PANEL_HEIGHT + FOOT, title) as figure:
        grid: list[Axes] = list(figure.subplots(rows, columns, squeeze=False).flat)
        for axes, setting in zip(grid, settings, strict=False):
            axes.set_title(f"{setting.figure}: {setting.title}")
        for axes in grid[count:]:
            axes.set_axis_off()
        yield figure, grid[:count]
