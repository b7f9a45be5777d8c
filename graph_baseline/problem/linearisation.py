"""The exact model of a recording, linearised at a solution, as arrays in world coordinates.

Unknowns are additive: dx_k = (x, y, heading) of pose k, dm = landmark positions. The model of motion noise is that of
GTSAM's between factor, Log(measured^-1 between) ~ N(0, Q) with the logarithm of SE(2). The linearised step is
dx_{k+1} = F dx_k + c + w, w ~ N(0, W), and W may be singular.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.preparation import prior_cov_in_body, require_known_landmarks
from slamgauge.recording import Recording
from slamgauge.se2 import between, log, pose_rotation, right_jacobian, rotation
from slamgauge.sensors import innovation, jacobian, predict


class LinearModel(NamedTuple):
    """dx_0 ~ N(start, start_cov); dx_{k+1} = F_k dx_k + c_k + w_k; 0 = Hx dx + Hm dm + r + noise, noise ~ N(0, I)."""

    start: Float  # (3,)
    start_cov: Float  # (3, 3)
    F: Float  # (N, 3, 3)
    c: Float  # (N, 3)
    W: Float  # (N, 3, 3)
    Hx: Float  # (M, d, 3), whitened
    Hm: Float  # (M, d, 2), whitened
    r: Float  # (M, d), whitened
    step: Int  # (M,) pose of each observation
    slot: Int  # (M,) landmark of each observation


def linearise(recording: Recording, slot: Int, poses: Float, landmarks: Float) -> LinearModel:
    """Return the model linearised at `poses` (N+1, 3) and `landmarks` (L, 2); observations have slots `slot` (M,)."""
    prior_residual = log(between(recording.prior_mean, poses[0])[None])
    residual = log(between(recording.odometry, between(poses[:-1], poses[1:])))
    turn = pose_rotation(poses[:, 2])
    F = np.tile(np.eye(3), (recording.steps, 1, 1))
    moved = np.diff(poses[:, :2], axis=0)
    F[:, 0, 2], F[:, 1, 2] = -moved[:, 1], moved[:, 0]
    B0 = turn[:1] @ right_jacobian(prior_residual)
    B = turn[1:] @ right_jacobian(residual)
    Hx, Hm, r = _observations(recording, slot, poses, landmarks)
    return LinearModel(
        start=-(turn[0] @ prior_residual[0]),
        start_cov=(B0 @ prior_cov_in_body(recording) @ B0.swapaxes(1, 2))[0],
        F=F,
        c=-np.einsum("nij,nj->ni", turn[1:], residual),
        W=B @ recording.odometry_cov @ B.swapaxes(1, 2),
        Hx=Hx,
        Hm=Hm,
        r=r,
        step=recording.observation_step,
        slot=slot,
    )


@np.errstate(divide="ignore", invalid="ignore")  # a landmark at the position of a pose gives NaN, which callers check
def _observations(recording: Recording, slot: Int, poses: Float, landmarks: Float) -> tuple[Float, Float, Float]:
    """Return whitened Jacobians by pose (M, d, 3) and landmark (M, d, 2), and whitened residuals h - z (M, d)."""
    offset, to_body, delta = _in_body(recording, slot, poses, landmarks)
    whitener = inverse_cholesky(recording.observation_cov)
    Hm = whitener @ (jacobian(recording.sensor, delta, nearest=0.0) @ to_body)
    lever = np.column_stack([-offset[:, 1], offset[:, 0]])
    Hx = np.concatenate([-Hm, -np.einsum("mij,mj->mi", Hm, lever)[:, :, None]], axis=2)
    return Hx, Hm, np.einsum("mij,mj->mi", whitener, _residuals(recording, delta))


def whitened_residuals(recording: Recording, slot: Int, poses: Float, landmarks: Float) -> Float:
    """Return whitened residuals h - z (M, d) of the observations."""
    delta = _in_body(recording, slot, poses, landmarks)[2]
    return np.einsum("mij,mj->mi", inverse_cholesky(recording.observation_cov), _residuals(recording, delta))


def _in_body(recording: Recording, slot: Int, poses: Float, landmarks: Float) -> tuple[Float, Float, Float]:
    """Return landmark minus robot position (M, 2), rotations (M, 2, 2) to the body frame, and their products (M, 2)."""
    pose = poses[recording.observation_step]
    offset = landmarks[slot] - pose[:, :2]
    to_body = rotation(pose[:, 2]).swapaxes(1, 2)
    return offset, to_body, np.einsum("mij,mj->mi", to_body, offset)


def _residuals(recording: Recording, delta: Float) -> Float:
    """Return predicted minus measured observations (M, d) for landmarks at `delta` (M, 2) in the body frame."""
    return innovation(recording.sensor, predict(recording.sensor, delta), recording.observation)


def inverse_cholesky(covariance: Float) -> Float:
    """Return lower triangular L^-1 (M, d, d) of covariances L L' (M, d, d)."""
    if covariance.shape[1] == 1:
        return 1.0 / np.sqrt(covariance)
    first = 1.0 / np.sqrt(covariance[:, 0, 0])
    slope = covariance[:, 0, 1] * first
    second = 1.0 / np.sqrt(covariance[:, 1, 1] - slope**2)
    inverse = np.zeros_like(covariance)
    inverse[:, 0, 0], inverse[:, 1, 1] = first, second
    inverse[:, 1, 0] = -slope * first * second
    return inverse


def cost(recording: Recording, poses: Float, landmark_ids: Int, landmarks: Float) -> float:
    """Return half the sum of squared whitened residuals of the exact model, which GTSAM calls the error.

    It is infinite if a motion violates a zero variance by more than 1e-6 (m or rad). `landmark_ids` must contain every
    landmark of the recording.
    """
    order = np.argsort(landmark_ids)
    slot = order[np.searchsorted(landmark_ids, require_known_landmarks(recording), sorter=order)]
    observed = whitened_residuals(recording, slot, poses, landmarks)
    prior = log(between(recording.prior_mean, poses[0])[None])
    motion = log(between(recording.odometry, between(poses[:-1], poses[1:])))
    squares = _mahalanobis(prior, prior_cov_in_body(recording)[None]) + _mahalanobis(motion, recording.odometry_cov)
    return 0.5 * (squares + float((observed**2).sum()))


def _mahalanobis(residual: Float, covariance: Float) -> float:
    """Return the sum of r' C^-1 r over rows, infinite if an r is not in the range of its C."""
    variance, axes = np.linalg.eigh(covariance)
    along = np.einsum("nij,ni->nj", axes, residual)
    free = variance > 1e-12 * variance[:, -1:]
    if (np.abs(along[~free]) > 1e-6).any():
        return np.inf
    return float((along[free] ** 2 / variance[free]).sum())
