"""Frames of stored covariances: GTSAM's `Marginals` are in the body frame, ours are in the world frame."""

from __future__ import annotations

from dataclasses import replace

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import StoredEstimate
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.nan_stats import defined_mean
from slamgauge.compare.scoring.own_stamps import truth_at
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import pose_rotation
from slamgauge.truth import Truth

FAR_BETTER = 2.0  # ratio of the mean NEES as read to that of rotated covariances, above which a warning is printed


def in_world_frame(stored: StoredEstimate) -> StoredEstimate:
    """Return a stored estimate with pose covariances of the body frame rotated to the world frame.

    Raises:
        UserError: it has no covariances.
    """

    def turned(estimate: Estimate) -> Estimate:
        if estimate.pose_covs is None:
            raise UserError("covariance-frame: the estimate has no covariances; leave this option out")
        return replace(estimate, pose_covs=_rotated(estimate.poses, estimate.pose_covs))

    return stored.changed(turned)


def frame_doubt(label: str, stored: StoredEstimate, truth: Truth | None, recording: Recording) -> str:
    """Return a warning if covariances fit the errors far better once they are rotated to the world frame, else ""."""
    estimate = stored.estimate if stored.own is None else stored.own.estimate
    if stored.own is not None:
        truth = truth_at(stored.own.stamps, truth, recording)
    if truth is None or truth.poses is None or estimate.pose_covs is None:
        return ""
    errors, covs = pose_errors(truth.poses, estimate.poses), estimate.pose_covs
    read, rotated = squared_mahalanobis(errors, covs), squared_mahalanobis(errors, _rotated(estimate.poses, covs))
    as_read, turned = defined_mean(read), defined_mean(rotated)
    if not as_read > FAR_BETTER * turned:  # NaN without a step that has both
        return ""
    what = f"the mean NEES is {as_read:.3g}, but {turned:.3g} if its covariances are in the body frame"
    return f"{label}: {what} (as GTSAM's Marginals gives them); then give --covariance-frame body"


def _rotated(poses: Float, covs: Float) -> Float:
    """Return covariances (n, 3, 3) of the body frames of poses (n, 3) in the world frame."""
    turns = pose_rotation(poses[:, 2])
    return turns @ covs @ turns.swapaxes(1, 2)
