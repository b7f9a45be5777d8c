"""Rigid alignment of a stored estimate with the true positions, by least squares (Umeyama, PAMI 13(4), 1991)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import StoredEstimate
from slamgauge.compare.scoring.own_stamps import truth_at
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.se2 import compose, pose_rotation, rotation
from slamgauge.truth import Truth


def aligned(label: str, stored: StoredEstimate, truth: Truth, recording: Recording) -> StoredEstimate:
    """Return a stored estimate moved and turned to fit the true positions; the transform is printed.

    Positions at the same times are compared. The scale is not changed.

    Raises:
        UserError: fewer than two poses have true positions.
    """
    estimate = stored.estimate if stored.own is None else stored.own.estimate
    reference = truth if stored.own is None else truth_at(stored.own.stamps, truth, recording)
    assert reference is not None
    assert reference.poses is not None
    known = np.isfinite(reference.poses[:, :2]).all(axis=1)
    if known.sum() < 2:
        raise UserError(f"align: {known.sum()} poses have true positions; two or more are needed")
    transform = rigid_transform(estimate.poses[known, :2], reference.poses[known, :2])
    x, y, turn = transform
    tell_once(f"{label}: turned by {turn:.4g} rad about the origin, then moved by ({x:.4g} m, {y:.4g} m)")
    return stored.changed(lambda each: _transformed(each, transform))


def rigid_transform(points: Float, targets: Float) -> Float:
    """Return the transform (x, y, turn) that takes points (n, 2) nearest to targets (n, 2)."""
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
