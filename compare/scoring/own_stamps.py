"""Score a stored trajectory at its own stamps: truth and optimum are what is interpolated, along the odometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import OwnPoses
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.compare.storage.trajectories import interpolated_covs
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, exp, log, wrap
from slamgauge.truth import Truth


def score_at_own_stamps(
    own: OwnPoses | None,
    truth: Truth | None,
    recording: Recording,
    estimate: Estimate,
    optimum: Estimate | None,
    batch: Estimate | None,
) -> Score:
    """Score an estimate as `evaluate` does; poses of a stored trajectory (`own`) are scored at their own stamps."""
    if own is None:
        return evaluate(truth, recording, estimate, optimum, batch)
    best, hindsight = (each and optimum_at(own.stamps, each, recording) for each in (optimum, batch))
    return evaluate(truth_at(own.stamps, truth, recording), recording, own.estimate, best, hindsight, own.compared)


def truth_at(stamps: Float, truth: Truth | None, recording: Recording) -> Truth | None:
    """Return the truth with poses at the given stamps (N+1,) [s] near the steps; NaN is a step without a stamp."""
    if truth is None or truth.poses is None:
        return truth
    return replace(truth, poses=_moved(truth.poses, between(truth.poses[:-1], truth.poses[1:]), recording, stamps))


def optimum_at(stamps: Float, optimum: Estimate, recording: Recording) -> Estimate:
    """Return an optimum with poses at the given stamps (N+1,) [s]; steps without a stamp keep their poses.

    A filtered pose follows the odometry from the step before, as its next measurement comes later.
    """
    times = np.where(np.isnan(stamps), recording.stamps, stamps)
    motions = recording.odometry
    if optimum.kind == "smoothed":
        motions = between(optimum.poses[:-1], optimum.poses[1:])
    covs = optimum.pose_covs
    return replace(
        optimum,
        poses=_moved(optimum.poses, motions, recording, times),
        pose_covs=None if covs is None else interpolated_covs(recording.stamps, covs, times),
    )


def _moved(poses: Float, motions: Float, recording: Recording, times: Float) -> Float:
    """Return poses (N+1, 3) moved to times (N+1,) [s] near their steps, on arcs of the motions (N, 3).

    A time before its step continues the motion that begins at the step before. Positions without headings are moved on
    straight lines. Without a motion there (a gap of the truth), and for a time of NaN, the pose is NaN.
    """
    found = np.where(np.isnan(times)[:, None], np.nan, poses)
    rows = np.flatnonzero(times != recording.stamps)
    rows = rows[~np.isnan(times[rows])]
    begin = np.clip(rows - (times[rows] < recording.stamps[rows]), 0, max(recording.steps - 1, 0))
    share = (times[rows] - recording.stamps[begin]) / (recording.stamps[begin + 1] - recording.stamps[begin])
    share = np.clip(share, 0.0, 1.0)[:, None]
    tangents = np.column_stack([motions[begin, :2], wrap(motions[begin, 2])])
    found[rows] = compose(poses[begin], exp(share * log(tangents)))
    headless = np.isnan(poses[begin, 2])
    lines = poses[begin] + share * (poses[begin + 1] - poses[begin])
    found[rows[headless]] = lines[headless]
    return found
