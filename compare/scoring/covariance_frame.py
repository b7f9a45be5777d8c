"""Frames of stored covariances: GTSAM's `Marginals` are in the body frame, ours are in the world frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.se2 import rotation, wrap
from slamgauge.truth import Truth

FAR_BETTER = 2.0  # ratio of the mean NEES as read to that of rotated covariances, above which a warning is printed


def in_world_frame(estimate: Estimate) -> Estimate:
    """Return the estimate with pose covariances of the body frame rotated to the world frame.

    Raises:
        UserError: it has no covariances.
    """
    if estimate.pose_covs is None:
        raise UserError("covariance-frame: the estimate has no covariances; leave this option out")
    return replace(estimate, pose_covs=_rotated(estimate.poses, estimate.pose_covs))


def frame_doubt(label: str, estimate: Estimate, truth: Truth | None, own: Marks | None) -> str:
    """Return a warning if covariances fit the errors far better once they are rotated to the world frame, else ""."""
    if truth is None or truth.poses is None or estimate.pose_covs is None:
        return ""
    known = np.isfinite(truth.poses).all(axis=1) & (np.linalg.eigvalsh(estimate.pose_covs)[:, 0] > 0.0)
    known &= True if own is None else own
    if not known.any():
        return ""
    errors = estimate.poses[known] - truth.poses[known]
    errors[:, 2] = wrap(errors[:, 2])
    as_read = _mean_nees(errors, estimate.pose_covs[known])
    turned = _mean_nees(errors, _rotated(estimate.poses, estimate.pose_covs)[known])
    if as_read <= FAR_BETTER * turned:
        return ""
    what = f"the mean NEES is {as_read:.3g}, but {turned:.3g} if its covariances are in the body frame"
    return f"{label}: {what} (as GTSAM's Marginals gives them); then give --covariance-frame body"


def _rotated(poses: Float, covs: Float) -> Float:
    """Return covariances (n, 3, 3) of the body frames of poses (n, 3) in the world frame."""
    turns = np.tile(np.eye(3), (len(poses), 1, 1))
    turns[:, :2, :2] = rotation(poses[:, 2])
    return turns @ covs @ turns.swapaxes(1, 2)


def _mean_nees(errors: Float, covs: Float) -> float:
    return float(np.mean(np.einsum("ni,ni->n", errors, np.linalg.solve(covs, errors[:, :, None])[:, :, 0])))
