"""Draw pose errors against time in three panels, with the 3-sigma bounds of each estimator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import CAUSAL, HINDSIGHT
from slamgauge.compare.figures.axes import exceeding, label_time, robust_limits
from slamgauge.compare.figures.downsampling import extreme_rows, marked_closures
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, MARK_COLOR, TRUTH_COLOR, styles
from slamgauge.compare.scoring.optimum_figures import is_in_doubt
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

PANELS = ("x [m]", "y [m]", "heading [°]")
LONG_TITLE = 45  # characters; a longer title does not fit a panel of figure.png
UNITS = np.array([1.0, 1.0, 180.0 / np.pi])


class Reference(NamedTuple):
    """Reference of the errors: title, poses (N+1, 3), and the name of the estimate if it is one."""

    title: str
    poses: Float
    name: str | None = None


def plot_errors(
    axes: Iterable[Axes],
    truth: Truth | None,
    recording: Recording,
    estimates: Mapping[str, Estimate],
    band: str | None = None,
) -> None:
    """Draw the errors in x, y [m] and heading [deg] against time on three axes, world frame.

    The 3-sigma bounds of the estimate `band` are filled (default: the first with covariances); those of the others are
    thin lines. Axis limits ignore diverged estimates, and the title names them. Dead reckoning is drawn only if it is
    the only estimate. Without true poses the differences to `batch`, or else to `causal`, are drawn; without these only
    the bounds.
    """
    panels = list(axes)
    reference = reference_of(truth, recording, estimates)
    shown = {name: each for name, each in estimates.items() if name != reference.name}
    is_hidden = len(shown) > 1 and shown.pop(DEAD_RECKONING, None) is not None
    chosen = styles(shown)
    filled = band or next((name for name, each in shown.items() if each.pose_covs is not None), None)
    times = recording.stamps
    extents: dict[str, Float] = {}
    for name, estimate in shown.items():
        color, dashes = chosen[name]
        errors, extents[name] = pose_errors(reference.poses, estimate.poses), np.zeros(len(panels))
        for axis, panel in enumerate(panels):
            rows = extreme_rows(errors[:, axis])
            error = UNITS[axis] * errors[rows, axis]
            panel.plot(times[rows], error, color=color, linestyle=dashes, linewidth=0.8, label=name, zorder=3)
            bound = _three_sigma(estimate, axis)
            rows = extreme_rows(bound)
            at, bound = times[rows], bound[rows]
            extents[name][axis] = np.nan_to_num(np.fmax.reduce([*np.abs(error), *bound]))
            if name == filled:
                panel.fill_between(at, -bound, bound, color=color, alpha=0.15, linewidth=0, zorder=1)
            panel.plot(at, bound, at, -bound, color=color, linewidth=0.5, alpha=0.8, zorder=2)
    closures, mark = marked_closures(truth, recording)
    limits, diverged = robust_limits(extents) if extents else (np.zeros(3), [])
    remarks = [*filter(None, [exceeding(diverged)]), *["dead reckoning not drawn"] * is_hidden]
    panels[0].set_title(_title(reference.title, f"({'; '.join(remarks)})" if remarks else ""))
    for panel, label, limit in zip(panels, PANELS, limits, strict=True):
        _finish(panel, label, times, times[closures], limit)
    label = [label_time(panel) for panel in panels][-1]
    ticks = "loop closures" if mark == "loop closure" else mark
    is_row = panels[0].get_position().y0 == panels[-1].get_position().y0
    loc = "right" if is_row else "center"  # in a row the panel is narrower than its label
    panels[-1].set_xlabel(f"{label}; ticks: {ticks}" if len(closures) else label, loc=loc)


def _title(what: str, remark: str) -> str:
    """Return title and remark in one line if they fit, else in two."""
    return (f"{what} {remark}" if len(what) + len(remark) < LONG_TITLE else f"{what}\n{remark}").strip()


def reference_of(truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate]) -> Reference:
    """Return the truth, or else the best available optimum, or else poses of NaN."""
    if truth is not None and truth.poses is not None:
        return Reference("error and ±3σ", truth.poses)
    for name in (HINDSIGHT, CAUSAL):
        if name in estimates:
            mark = MARK if is_in_doubt(estimates[name].optimum_check) else ""
            return Reference(f"difference to {name}{mark} and ±3σ", estimates[name].poses, name)
    return Reference("±3σ only: no truth, no optimum", np.full((recording.steps + 1, 3), np.nan))


def _three_sigma(estimate: Estimate, axis: int) -> Float:
    """Return 3-sigma bounds (N+1,) of a coordinate [m] or [deg]; NaN without covariances."""
    if estimate.pose_covs is None:
        return np.full(len(estimate.poses), np.nan)
    return 3 * UNITS[axis] * np.sqrt(estimate.pose_covs[:, axis, axis].clip(min=0))


def _finish(panel: Axes, label: str, times: Float, closures: Float, limit: float) -> None:
    """Set symmetric limits, which make a bias visible; draw the zero line and marks at loop closures."""
    height = 1.1 * limit or 1.0
    panel.set_ylim(-height, height)
    panel.axhline(0, color=MARK_COLOR, linewidth=0.5, zorder=0)
    panel.vlines(closures, 0, 0.06, transform=panel.get_xaxis_transform(), color=TRUTH_COLOR, linewidth=0.4)
    panel.set_xlim(times[0], times[-1])
    panel.set_ylabel(label)
