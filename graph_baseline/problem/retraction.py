"""Retractions of a linear step on paths that satisfy the constraints of zero variances.

Two retractions are equal to first order, and differ if a step bends the path strongly: `retract_pointwise` moves each
pose by its step, `retract_by_motions` changes each motion by a small amount. The solver uses the result with the lower
cost.

The residual of a motion is xi = Log(measured^-1 between) in SE(2). It is written as xi = D V c: D contains the standard
deviations of the noise, and the columns of V span the range of its correlation matrix. The start is treated as a motion
from the prior mean.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.preparation import Problem, prior_cov_in_body
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, exp, log, right_jacobian, rotation, wrap

SINGULAR = 1e-12  # smaller eigenvalues of a correlation matrix are treated as zero


class MotionNoise:
    """Residuals of the start and of the motions in the directions with noise."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        covs = np.concatenate([prior_cov_in_body(recording)[None], recording.odometry_cov])
        sigma = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
        self._scale = np.where(sigma > 0.0, sigma, 1.0)
        weights, self._axes = np.linalg.eigh(covs / (self._scale[:, :, None] * self._scale[:, None, :]))
        self._free = weights > SINGULAR
        self._root = np.sqrt(np.where(self._free, weights, 1.0))

    def cost(self, poses: Float) -> float:
        """Return half the sum of squared whitened residuals of poses (N+1, 3), without constrained directions."""
        return 0.5 * float(np.square(self._coordinates(self.residuals(poses)) / self._root).sum())

    def violation(self, poses: Float) -> float:
        """Return the largest residual of poses (N+1, 3) in constrained directions [m or rad]."""
        residuals = self.residuals(poses)
        allowed = np.einsum("nij,nj->ni", self._axes, self._coordinates(residuals)) * self._scale
        return float(np.abs(residuals - allowed).max())

    def satisfying_constraints(self, poses: Float) -> Float:
        """Return poses (N+1, 3) with the residuals of `poses`, but zero residuals in constrained directions."""
        return poses if self._free.all() else self.path(self.residuals(poses))

    def path(self, residuals: Float) -> Float:
        """Return poses (N+1, 3) with the given residuals (N+1, 3), but zero residuals in constrained directions."""
        recording = self._recording
        increments = exp(np.einsum("nij,nj->ni", self._axes, self._coordinates(residuals)) * self._scale)
        return chain(compose(recording.prior_mean, increments[0]), compose(recording.odometry, increments[1:]))

    def residuals(self, poses: Float) -> Float:
        """Return the residuals (N+1, 3) of the start and the motions of poses (N+1, 3)."""
        recording = self._recording
        start = between(recording.prior_mean, poses[0])[None]
        motion = between(recording.odometry, between(poses[:-1], poses[1:]))
        return log(np.concatenate([start, motion]))

    def _coordinates(self, residuals: Float) -> Float:
        """Return scaled residuals (N+1, 3) along the axes of their noise, zero in constrained directions."""
        return np.einsum("nij,ni->nj", self._axes, residuals / self._scale) * self._free


def retract_pointwise(
    problem: Problem, noise: MotionNoise, poses: Float, landmarks: Float, dx: Float, dm: Float
) -> tuple[Float, Float]:
    """Return path and map after a step (N+1, 3), (L, 2): each point moves by V(turn) step, V(t) = (R(t) - I) / (t J).

    A rotation of all points about a common centre then keeps all distances; an additive step would stretch them. The
    turn of a landmark is the mean turn of the poses that observe it.
    """
    turn = dx[:, 2]
    seen = np.maximum(np.bincount(problem.slot, minlength=len(dm)), 1)
    turn_of_landmark = np.bincount(problem.slot, turn[problem.observation_step], minlength=len(dm)) / seen
    path = np.column_stack([poses[:, :2] + exp(dx)[:, :2], wrap(poses[:, 2] + turn)])
    return noise.satisfying_constraints(path), landmarks + exp(np.column_stack([dm, turn_of_landmark]))[:, :2]


def retract_by_motions(
    problem: Problem, noise: MotionNoise, poses: Float, landmarks: Float, dx: Float, dm: Float
) -> tuple[Float, Float]:
    """Return path and map after a step (N+1, 3), (L, 2) that changes the residuals of the motions.

    A turn of one motion rotates all later poses. A landmark moves with the pose of its first observation, plus its step
    relative to this pose.
    """
    change, moved = dx.copy(), np.diff(poses[:, :2], axis=0)
    change[1:] -= dx[:-1]
    change[1:, 0] += moved[:, 1] * dx[:-1, 2]
    change[1:, 1] -= moved[:, 0] * dx[:-1, 2]
    change[:, :2] = np.einsum("nji,nj->ni", rotation(poses[:, 2]), change[:, :2])
    residual = noise.residuals(poses)
    path = noise.path(residual + np.linalg.solve(right_jacobian(residual), change[:, :, None])[:, :, 0])
    at = problem.observation_step[problem.first_row]
    offset = landmarks - poses[at, :2]
    across = np.column_stack([-offset[:, 1], offset[:, 0]])
    offset += dm - dx[at, :2] - across * dx[at, 2:]
    turn = rotation(path[at, 2] - poses[at, 2])
    return path, path[at, :2] + np.einsum("nij,nj->ni", turn, offset)
