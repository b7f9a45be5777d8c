"""Figures of a run: the map and the errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase, SubFigure
from matplotlib.transforms import ScaledTranslation

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import OPTIMA
from slamgauge.compare.figures.error_panels import marked_closures, plot_errors
from slamgauge.compare.figures.map_contents import map_limits
from slamgauge.compare.figures.map_layers import (
    POINT,
    TRUE_ROBOT,
    draw_ellipses,
    draw_path,
    draw_true_landmarks,
    explain,
)
from slamgauge.compare.figures.plot_style import (
    DEAD_RECKONING,
    TRUTH_COLOR,
    Style,
    legend_below,
    printed,
    sheet,
    styles,
)
from slamgauge.compare.scoring.optimum_notes import doubt, is_misfit, misfits
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.truth import Truth

__all__ = ["plot_errors", "plot_run", "save_figure"]

HEIGHTS = {"page": 4.6, "column": 7.2}  # [in] of figure.png
DIAMOND: dict[str, Any] = {"markersize": 3, "color": "w", "markeredgecolor": TRUTH_COLOR, "markeredgewidth": 0.6}
ROOM_OF_LABEL = 3.5  # space between axes and legend, in font heights of the axis label
POSE_ELLIPSES = 15  # per path; odd, so that two loops do not have them at the same positions
LANDMARK_ELLIPSES = 150  # with more in all maps, only those of the first map are drawn


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
    doubts = [misfits([name for name in OPTIMA.values() if name in estimates and is_misfit(estimates[name])])]
    doubts += [doubt(name, estimate.optimum_check) for name, estimate in estimates.items()]
    title = "\n".join([title, *filter(None, doubts)])
    with printed(Path(folder) / "figure", HEIGHTS[sheet().width], title) as figure:
        draw_map_and_errors(figure, truth, recording, estimates)


def draw_map_and_errors(
    figure: FigureBase, truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]
) -> None:
    """Draw the map, the errors and their legend into an empty figure; arguments as for `plot_errors`."""
    if sheet().is_narrow:
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
    paths = {DEAD_RECKONING: chain(recording.prior_mean, recording.odometry)}
    paths |= {name: estimate.poses for name, estimate in estimates.items()}
    chosen = styles(paths)
    if truth.poses is not None:
        draw_path(ax, truth.poses[:, :2], TRUE_ROBOT, "truth")
    for name, poses in paths.items():
        draw_path(ax, poses[:, :2], chosen[name], name)
    _draw_maps(ax, truth, recording, estimates, chosen)
    path = truth.poses if truth.poses is not None else list(paths.values())[-1]
    closures, label = marked_closures(truth, recording)
    if len(closures):
        ax.plot(*path[closures, :2].T, "d", label=label, zorder=4, **DIAMOND)
    ax.plot(*recording.prior_mean[:2, None], "o", color=TRUTH_COLOR, markersize=4, label="start", zorder=4)
    explain(ax, ellipses=bool(ax.collections))
    mapped = [estimate.landmarks for estimate in estimates.values()]
    _frame(ax, paths, [each for each in (truth.poses, truth.landmarks) if each is not None] or mapped)


def _draw_maps(
    ax: Axes,
    truth: Truth,
    recording: Recording,
    estimates: Mapping[str, Estimate],
    chosen: Mapping[str, Style],
) -> None:
    """Draw true landmarks, mapped landmarks and the ellipses of maps and paths."""
    draw_true_landmarks(ax, truth.landmarks)
    landmark_covs = {name: each.landmark_covs for name, each in estimates.items() if each.landmark_covs is not None}
    if sum(len(covs) for covs in landmark_covs.values()) > LANDMARK_ELLIPSES:
        landmark_covs = dict(islice(landmark_covs.items(), 1))
    some = np.linspace(0, recording.steps, POSE_ELLIPSES + 1).astype(int)[1:]
    for name, estimate in estimates.items():
        color = chosen[name].color
        ax.plot(*estimate.landmarks.T, color=color, zorder=3, **POINT)
        if name in landmark_covs:
            draw_ellipses(ax, estimate.landmarks, landmark_covs[name], color)
        if estimate.pose_covs is not None and name != DEAD_RECKONING:
            draw_ellipses(ax, estimate.poses[some, :2], estimate.pose_covs[some, :2, :2], color)


def _frame(ax: Axes, paths: Mapping[str, Float], others: list[Float]) -> None:
    """Set limits at equal scales around everything except a drifted dead reckoning."""
    drift = [poses[:, :2] for name, poses in paths.items() if name == DEAD_RECKONING]
    estimated = [poses for name, poses in paths.items() if name != DEAD_RECKONING] or drift
    low, high = map_limits([each[:, :2] for each in estimated + others], drift)
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlim(low[0], high[0], auto=True)
    ax.set_ylim(low[1], high[1], auto=True)
    if any(((each < low) | (each > high)).any() for each in drift):
        ax.set_title("dead reckoning exceeds the axes")
