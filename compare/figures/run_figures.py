"""Figures of a run: the map, and the errors against time in three panels with the 3-sigma bounds of each estimator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase, SubFigure
from matplotlib.transforms import ScaledTranslation

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.registry import CAUSAL, DEAD_RECKONING, HINDSIGHT, OPTIMA
from slamgauge.compare.figures.curves import curve, exceeding, robust_limits, three_sigma
from slamgauge.compare.figures.maps import (
    POINT,
    TRUE_ROBOT,
    draw_ellipses,
    draw_path,
    draw_true_landmarks,
    explain,
    map_limits,
)
from slamgauge.compare.figures.plot_style import MARK_COLOR, SHEET, TRUTH_COLOR, legend_below, printed, styles
from slamgauge.compare.scoring.consistency import pose_errors
from slamgauge.compare.scoring.optimum_notes import MARK, doubt, is_in_doubt, is_misfit, misfits
from slamgauge.compare.scoring.run_arrays import closure_steps, pose_covs_of
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.truth import Truth

HEIGHTS = {"page": 4.6, "column": 7.2}  # [in] of figure.png
DIAMOND: dict[str, Any] = {"markersize": 3, "color": "w", "markeredgecolor": TRUTH_COLOR, "markeredgewidth": 0.6}
ROOM_OF_LABEL = 3.5  # space between axes and legend, in font heights of the axis label
POSE_ELLIPSES = 15  # per path; odd, so that two loops do not have them at the same positions
LANDMARK_ELLIPSES = 150  # with more in all maps, only those of the first map are drawn
PANELS = ("x [m]", "y [m]", "heading [°]")
LONG_TITLE = 45  # characters; a longer title does not fit a panel of figure.png
UNITS = np.array([1.0, 1.0, 180.0 / np.pi])
MOST_CLOSURES = 60  # more marks would hide the paths, and the ticks would merge into a bar


class Reference(NamedTuple):
    """Reference of the errors: title, poses (N+1, 3), and the name of the estimate if it is one."""

    title: str
    poses: Float
    name: str | None = None


def plot_run(ax: Axes, truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]) -> None:
    """Draw the map of a run: paths, landmarks and 3-sigma ellipses in the world frame [m].

    Dead reckoning is computed from the recording if the estimates do not contain it; the limits ignore it if it drifts
    far away. The legend is below the axes.
    """
    _draw_run(ax, truth, recording, estimates)
    room = ROOM_OF_LABEL * ax.xaxis.label.get_fontproperties().get_size_in_points() / 72
    lower = ScaledTranslation(0.0, -room, ax.figure.dpi_scale_trans)
    ax.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 0.0), bbox_transform=ax.transAxes + lower)


def save_figure(
    folder: str | Path, truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate], title: str
) -> None:
    """Write figure.png (200 dpi) and figure.svg into `folder`: the map and the errors.

    The title names an optimum whose check or residuals put it in doubt.
    """
    misfitting = [name for name in OPTIMA.values() if name in estimates and is_misfit(estimates[name])]
    doubts = [misfits(misfitting)]
    doubts += [doubt(name, estimate.optimum_check) for name, estimate in estimates.items()]
    title = "\n".join([title, *filter(None, doubts)])
    with printed(Path(folder) / "figure", HEIGHTS[SHEET.get().width], title) as figure:
        draw_map_and_errors(figure, truth, recording, estimates)


def draw_map_and_errors(
    figure: FigureBase, truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]
) -> None:
    """Draw the map, the errors and their legend into an empty figure; arguments as for `plot_errors`."""
    if SHEET.get().is_narrow:
        parts = figure.subfigures(2, 1, height_ratios=(1, 1.1))
    else:
        parts = figure.subfigures(1, 2, width_ratios=(1.25, 1))
    left, right = cast("Iterable[SubFigure]", parts)
    axes = left.subplots()
    _draw_run(axes, truth, recording, estimates)
    plot_errors(right.subplots(3, sharex=True), truth, recording, estimates)
    legend_below(figure, axes.get_legend_handles_labels()[0])


def _draw_run(ax: Axes, truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]) -> None:
    truth = Truth() if truth is None else truth
    paths = _paths(recording, estimates)
    chosen = styles(paths)
    if truth.poses is not None:
        draw_path(ax, truth.poses[:, :2], TRUE_ROBOT, "truth")
    for name, poses in paths.items():
        draw_path(ax, poses[:, :2], chosen[name], name)
    draw_true_landmarks(ax, truth.landmarks)
    covs = {name: each.landmark_covs for name, each in estimates.items() if each.landmark_covs is not None}
    if sum(map(len, covs.values())) > LANDMARK_ELLIPSES:
        covs = dict(islice(covs.items(), 1))
    some = np.linspace(0, recording.steps, POSE_ELLIPSES + 1).astype(int)[1:]
    for name, estimate in estimates.items():
        color = chosen[name].color
        ax.plot(*estimate.landmarks.T, color=color, zorder=3, **POINT)
        if name in covs:
            draw_ellipses(ax, estimate.landmarks, covs[name], color)
        if estimate.pose_covs is not None and name != DEAD_RECKONING:
            draw_ellipses(ax, estimate.poses[some, :2], estimate.pose_covs[some, :2, :2], color)
    path = truth.poses if truth.poses is not None else [*paths.values()][-1]
    closures, label = marked_closures(truth, recording)
    if len(closures):
        ax.plot(*path[closures, :2].T, "d", label=label, zorder=4, **DIAMOND)
    start_x, start_y, _ = recording.prior_mean
    ax.plot(start_x, start_y, "o", color=TRUTH_COLOR, markersize=4, label="start", zorder=4)
    explain(ax, ellipses=bool(ax.collections))
    low, high = run_limits(truth, recording, estimates)
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlim(low[0], high[0], auto=True)
    ax.set_ylim(low[1], high[1], auto=True)
    drift = paths[DEAD_RECKONING][:, :2]
    if ((drift < low) | (drift > high)).any():
        ax.set_title("dead reckoning exceeds the axes")


def _paths(recording: Recording, estimates: Mapping[str, Estimate]) -> dict[str, Float]:
    """Return the poses (N+1, 3) of dead reckoning and of the estimates."""
    paths = {DEAD_RECKONING: chain(recording.prior_mean, recording.odometry)}
    for name, estimate in estimates.items():
        paths[name] = estimate.poses
    return paths


def run_limits(truth: Truth, recording: Recording, estimates: Mapping[str, Estimate]) -> tuple[Float, Float]:
    """Return corners low and high (2,) [m] around paths and landmarks; a drifted dead reckoning does not count."""
    paths = _paths(recording, estimates)
    drift = [paths.pop(DEAD_RECKONING)[:, :2]]
    known = [each for each in (truth.poses, truth.landmarks) if each is not None]
    mapped = [estimate.landmarks for estimate in estimates.values()]
    sure = [each[:, :2] for each in (*paths.values(), *(known or mapped))]
    return map_limits(sure or drift, drift)


def plot_errors(
    axes: Iterable[Axes], truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]
) -> None:
    """Draw the errors in x, y [m] and heading [deg] against the time since the start on three axes, world frame.

    The 3-sigma bounds of the first estimate with covariances are filled; those of the others are thin lines. Axis
    limits ignore diverged estimates, and the title names them. Dead reckoning is drawn only if it is the only estimate.
    Without true poses the differences to `batch`, or else to `causal`, are drawn; without these only the bounds.
    """
    panels = list(axes)
    reference = reference_of(truth, recording, estimates)
    shown = {name: each for name, each in estimates.items() if name != reference.name}
    is_hidden = len(shown) > 1 and shown.pop(DEAD_RECKONING, None) is not None
    filled = next((name for name, each in shown.items() if each.pose_covs is not None), None)
    time = recording.stamps - recording.stamps[0]
    extents: dict[str, Float] = {}
    for name, style in styles(shown).items():
        errors = UNITS * pose_errors(reference.poses, shown[name].poses)
        variances = np.diagonal(pose_covs_of(shown[name]), axis1=1, axis2=2)
        sigmas = UNITS * np.sqrt(variances.clip(min=0))
        for panel, error, sigma in zip(panels, errors.T, sigmas.T, strict=True):
            curve(panel, time, error, style, name, linewidth=0.8, zorder=3)
            three_sigma(panel, time, sigma, style, filled=name == filled)
        largest = np.fmax.reduce([*np.abs(errors), *(3.0 * sigmas)])
        extents[name] = np.nan_to_num(largest)
    limits, diverged = robust_limits(extents) if extents else (np.zeros(3), [])
    remarks = [exceeding(diverged)] if diverged else []
    if is_hidden:
        remarks.append("dead reckoning not drawn")
    remark = f"({'; '.join(remarks)})" if remarks else ""
    gap = "\n" if len(reference.title) + len(remark) >= LONG_TITLE else " "
    panels[0].set_title(gap.join(filter(None, (reference.title, remark))))
    closures, mark = marked_closures(truth, recording)
    for panel, label, limit in zip(panels, PANELS, limits, strict=True):
        height = 1.1 * limit or 1.0  # symmetric limits make a bias visible
        panel.set(xlim=(time[0], time[-1]), ylim=(-height, height), ylabel=label)
        panel.axhline(0, color=MARK_COLOR, linewidth=0.5, zorder=0)
        ticks = panel.get_xaxis_transform()
        panel.vlines(time[closures], 0, 0.06, transform=ticks, color=TRUTH_COLOR, linewidth=0.4)
    panels[-1].set_xlabel(f"time [s]; ticks: {mark}" if len(closures) else "time [s]")


def reference_of(truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]) -> Reference:
    """Return the truth, or else the best available optimum, or else poses of NaN."""
    if truth is not None and truth.poses is not None:
        return Reference("error and ±3σ", truth.poses)
    for name in (HINDSIGHT, CAUSAL):
        if name in estimates:
            mark = MARK if is_in_doubt(estimates[name].optimum_check) else ""
            return Reference(f"difference to {name}{mark} and ±3σ", estimates[name].poses, name)
    return Reference("±3σ only: no truth, no optimum", np.full((recording.steps + 1, 3), np.nan))


def marked_closures(truth: Truth | None, recording: Recording) -> tuple[Int, str]:
    """Return the steps of the loop closures to mark, and the label of a mark; no steps if associations are unknown."""
    steps = closure_steps(truth, recording)
    if steps is None:
        return recording.observation_step[:0], ""
    every = max(1, -(-len(steps) // MOST_CLOSURES))
    return steps[::every], "loop closures" if every == 1 else f"1 in {every} loop closures"
