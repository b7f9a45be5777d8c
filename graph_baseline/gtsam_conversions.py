"""Noise models, values and marginal covariances: from arrays to GTSAM's objects, and back."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.preparation import prior_cov_in_body
from slamgauge.recording import Recording
from slamgauge.se2 import pose_rotation
from slamgauge.validation import is_one_for_all


def motion_noise(recording: Recording, regularising: float) -> list[gtsam.noiseModel.Base]:
    """Return N+1 noise models, of the prior and of each odometry increment.

    Args:
        recording: the covariances may be singular. A step without any noise becomes a constraint.
        regularising: smallest standard deviation relative to the largest of the same step; for the prior, relative to
            the largest of the prior and the first step.
    """
    covs = np.concatenate([prior_cov_in_body(recording)[None], recording.odometry_cov])
    largest = covs.max(axis=(1, 2))
    largest[0] = largest[:2].max()
    minimum_sigmas = regularising * np.sqrt(largest)
    return [_noise_model(cov, minimum) for cov, minimum in zip(covs, minimum_sigmas.tolist(), strict=True)]


def observation_noise(covs: Float) -> list[gtsam.noiseModel.Base]:
    """Return the noise models of covariances (M, d, d) of range and bearing; GTSAM's order is bearing, then range."""
    if is_one_for_all(covs):
        return len(covs) * [_noise_model(cov, 0.0) for cov in covs[:1, ::-1, ::-1]]
    return [_noise_model(cov, 0.0) for cov in covs[:, ::-1, ::-1]]


def _noise_model(covariance: Float, minimum_sigma: float) -> gtsam.noiseModel.Base:
    """Return the noise model of a covariance (d, d) whose standard deviations are raised to `minimum_sigma`."""
    sigmas = np.sqrt(np.diag(covariance))
    correlated = np.abs(covariance) > 1e-12 * np.outer(sigmas, sigmas)  # smaller entries are rounding of a rotation
    if not (correlated & ~np.eye(len(covariance), dtype=bool)).any():
        return gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sigmas, minimum_sigma))
    scale = np.where(sigmas > 0, sigmas, 1.0)
    if np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] < 1e-12:
        variances, axes = np.linalg.eigh(covariance)
        covariance = axes * np.maximum(variances, minimum_sigma**2) @ axes.T
    # smart=False: GTSAM's smart mode drops correlations of covariances below 1e-9
    return gtsam.noiseModel.Gaussian.Covariance(covariance, False)


def make_values(poses: Float, landmark_ids: Int, landmarks: Float) -> gtsam.Values:
    """Return poses (N+1, 3) and landmarks (L, 2) as GTSAM's values."""
    values = gtsam.Values()
    for k, pose in enumerate(poses.tolist()):
        values.insert(X(k), gtsam.Pose2(*pose))
    for name, landmark in zip(landmark_ids.tolist(), landmarks.tolist(), strict=True):
        values.insert(L(name), gtsam.Point2(*landmark))
    return values


def read_values(values: gtsam.Values) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2) in increasing id order."""
    return gtsam.utilities.extractPose2(values), gtsam.utilities.extractPoint2(values).reshape(-1, 2)


def marginals_of(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Marginals | gtsam.ISAM2:
    """Return an object with GTSAM's marginal covariances of a graph at its optimum.

    On long paths the Cholesky factorisation of `Marginals` loses the digits of regularising noise, which QR keeps.
    """
    try:
        return gtsam.Marginals(graph, values)
    except RuntimeError:
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        isam = gtsam.ISAM2(parameters)
        isam.update(graph, values)
        return isam


def pose_array(pose: gtsam.Pose2) -> Float:
    """Return a pose as (x, y, heading), (3,)."""
    return np.array([pose.x(), pose.y(), pose.theta()])


def covariance_in_world(heading: ArrayLike, covariance: Float) -> Float:
    """Return the covariances (..., 3, 3) of the additive pose error in the world frame, T C T' with T = blkdiag(R, 1).

    GTSAM's `covariance` C (..., 3, 3) is in the frame of the pose; R is its rotation by `heading` (...).
    """
    turn = pose_rotation(heading)
    return turn @ covariance @ turn.swapaxes(-1, -2)
