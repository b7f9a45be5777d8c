"""Stored trajectories: truth and optimum at their own stamps, alignment, and covariances of the body frame.

Truth and optimum are what is interpolated to the stamps of a trajectory, along the odometry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import StoredEstimate
from slamgauge.compare.scoring.consistency import pose_errors, squared_mahalanobis
from slamgauge.compare.scoring.intervals import defined_mean
from slamgauge.compare.storage.trajectories import interpolated_covs
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, exp, log, pose_rotation, rotation, wrap
from slamgauge.truth import Truth

FAR_BETTER = 2.0  # ratio of the mean NEES as read to that of rotated covariances, above which a warning is printed


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
    rows = np.flatnonzero((times != recording.stamps) & ~np.isnan(times))
    begin = np.clip(rows - (times[rows] < recording.stamps[rows]), 0, max(recording.steps - 1, 0))
    share = (times[rows] - recording.stamps[begin]) / (recording.stamps[begin + 1] - recording.stamps[begin])
    share = np.clip(share, 0.0, 1.0)[:, None]
    tangents = np.column_stack([motions[begin, :2], wrap(motions[begin, 2])])
    arcs = compose(poses[begin], exp(share * log(tangents)))
    lines = poses[begin] + share * (poses[begin + 1] - poses[begin])
    found[rows] = np.where(np.isnan(poses[begin, 2:]), lines, arcs)
    return found


def aligned(label: str, stored: StoredEstimate, truth: Truth, recording: Recording) -> StoredEstimate:
    """Return a stored estimate moved and turned to fit the true positions; the transform is printed."""
    estimate, reference = _with_truth(stored, truth, recording)
    known = np.isfinite(reference[:, :2]).all(axis=1)
    if known.sum() < 2:
        raise UserError(f"align: {known.sum()} poses have true positions; two or more are needed")
    transform = rigid_transform(estimate.poses[known, :2], reference[known, :2])
    x, y, turn = transform
    tell_once(f"{label}: turned by {turn:.4g} rad about the origin, then moved by ({x:.4g} m, {y:.4g} m)")
    return stored.changed(lambda each: _transformed(each, transform))


def rigid_transform(points: Float, targets: Float) -> Float:
    """Return the transform (x, y, turn) that takes points (n, 2) nearest to targets (n, 2), by least squares.

    Source: Umeyama, PAMI 13(4), 1991.
    """
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    (a, b), (c, d) = (points - middle).T @ (targets - goal)
    turn = np.arctan2(b - c, a + d)
    return np.append(goal - rotation(turn) @ middle, turn)


def _transformed(estimate: Estimate, transform: Float) -> Estimate:
    """Return an estimate with poses, landmarks and covariances in the frame that the transform (3,) leads to."""
    turn, turn_3 = rotation(transform[2]), pose_rotation(transform[2])
    covs, map_covs = estimate.pose_covs, estimate.landmark_covs
    return replace(
        estimate,
        poses=compose(transform, estimate.poses),
        pose_covs=None if covs is None else turn_3 @ covs @ turn_3.T,
        landmarks=estimate.landmarks @ turn.T + transform[:2],
        landmark_covs=None if map_covs is None else turn @ map_covs @ turn.T,
        rays=None,
        history=None,
    )


def in_world_frame(stored: StoredEstimate) -> StoredEstimate:
    """Return a stored estimate with pose covariances of the body frame rotated to the world frame."""
    if stored.estimate.pose_covs is None:
        raise UserError("covariance-frame: the estimate has no covariances; leave this option out")
    return stored.changed(lambda each: replace(each, pose_covs=_rotated(each)))


def frame_doubt(label: str, stored: StoredEstimate, truth: Truth | None, recording: Recording) -> str:
    """Return a warning if covariances fit the errors far better once they are rotated to the world frame, else ""."""
    estimate, reference = _with_truth(stored, truth, recording)
    if estimate.pose_covs is None:
        return ""
    errors, covs = pose_errors(reference, estimate.poses), (estimate.pose_covs, _rotated(estimate))
    read, turned = (defined_mean(squared_mahalanobis(errors, each)) for each in covs)
    if not read > FAR_BETTER * turned:  # NaN without a step that has both
        return ""
    what = f"the mean NEES is {read:.3g}, but {turned:.3g} if its covariances are in the body frame"
    return f"{label}: {what} (as GTSAM's Marginals gives them); then give --covariance-frame body"


def _with_truth(stored: StoredEstimate, truth: Truth | None, recording: Recording) -> tuple[Estimate, Float]:
    """Return the estimate, at its own stamps if it has any, and the true poses (N+1, 3) there; NaN if unknown."""
    if stored.own is not None:
        truth = truth_at(stored.own.stamps, truth, recording)
    estimate = stored.estimate if stored.own is None else stored.own.estimate
    poses = None if truth is None else truth.poses
    return estimate, np.full(estimate.poses.shape, np.nan) if poses is None else poses


def _rotated(estimate: Estimate) -> Float:
    """Return pose covariances (N+1, 3, 3) of the body frame in the world frame: GTSAM's `Marginals` are in the body."""
    assert estimate.pose_covs is not None
    turns = pose_rotation(estimate.poses[:, 2])
    return turns @ estimate.pose_covs @ turns.swapaxes(1, 2)
