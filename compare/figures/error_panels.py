"""Draw pose errors against time in three panels, with the 3-sigma bounds of each estimator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.registry import CAUSAL, HINDSIGHT
from slamgauge.compare.figures.axes import curve, exceeding, robust_limits, three_sigma
from slamgauge.compare.figures.plot_style import DEAD_RECKONING, MARK_COLOR, TRUTH_COLOR, styles
from slamgauge.compare.scoring.consistency import pose_errors
from slamgauge.compare.scoring.optimum_notes import MARK, is_in_doubt
from slamgauge.compare.scoring.run_arrays import closure_steps
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

PANELS = ("x [m]", "y [m]", "heading [°]")
LONG_TITLE = 45  # characters; a longer title does not fit a panel of figure.png
UNITS = np.array([1.0, 1.0, 180.0 / np.pi])
MOST_CLOSURES = 60  # more marks would hide the paths, and the ticks would merge into a bar


class Reference(NamedTuple):
    """Reference of the errors: title, poses (N+1, 3), and the name of the estimate if it is one."""

    title: str
    poses: Float
    name: str | None = None


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
        sigmas = _sigmas(shown[name])
        for panel, error, sigma in zip(panels, errors.T, sigmas.T, strict=True):
            curve(panel, time, error, style, name, linewidth=0.8, zorder=3)
            three_sigma(panel, time, sigma, style, filled=name == filled)
        extents[name] = np.nan_to_num(np.fmax.reduce([*np.abs(errors), *(3.0 * sigmas)]))
    limits, diverged = robust_limits(extents) if extents else (np.zeros(3), [])
    remarks = [*filter(None, [exceeding(diverged)]), *["dead reckoning not drawn"] * is_hidden]
    panels[0].set_title(_title(reference.title, f"({'; '.join(remarks)})" if remarks else ""))
    closures, mark = marked_closures(truth, recording)
    for panel, label, limit in zip(panels, PANELS, limits, strict=True):
        height = 1.1 * limit or 1.0  # symmetric limits make a bias visible
        panel.set(xlim=(time[0], time[-1]), ylim=(-height, height), ylabel=label)
        panel.axhline(0, color=MARK_COLOR, linewidth=0.5, zorder=0)
        ticks = panel.get_xaxis_transform()
        panel.vlines(time[closures], 0, 0.06, transform=ticks, color=TRUTH_COLOR, linewidth=0.4)
    panels[-1].set_xlabel(f"time [s]; ticks: {mark}" if len(closures) else "time [s]")


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


def _sigmas(estimate: Estimate) -> Float:
    """Return standard deviations (N+1, 3) in [m], [m] and [deg]; NaN without covariances."""
    if estimate.pose_covs is None:
        return np.full((len(estimate.poses), 3), np.nan)
    return UNITS * np.sqrt(np.diagonal(estimate.pose_covs, axis1=1, axis2=2).clip(min=0))


def marked_closures(truth: Truth | None, recording: Recording) -> tuple[Int, str]:
    """Return the steps of the loop closures to mark, and the label of a mark; no steps if associations are unknown."""
    steps = closure_steps(truth, recording)
    if steps is None:
        return recording.observation_step[:0], ""
    every = max(1, -(-len(steps) // MOST_CLOSURES))
    return steps[::every], "loop closures" if every == 1 else f"1 in {every} loop closures"
