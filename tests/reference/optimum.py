"""The optimum by scipy, independent of GTSAM and of the project's smoother.

Unknowns are the landmarks and unit-variance coordinates of the noise of the start and of each motion:
x_0 = mean Exp(B_0 a), x_k = x_{k-1} u_k Exp(B_k w_k). Noise without variance has no unknown, so motion without lateral
slip and a fixed start are exact. The motion noise is that of GTSAM's between factor: Log(u^-1 between) with the
covariance of the recording.

All functions accept leading axes, so that one call evaluates all points of a difference formula.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation, wrap


def exp_se2(tangent: Float) -> Float:
    """Return the exponential (..., 3) of SE(2) without cancellation; GTSAM's loses digits below 0.1 rad."""
    x, y, turn = np.moveaxis(tangent, -1, 0)
    cosine, sine = np.sinc(turn / math.pi), np.sin(turn / 2) * np.sinc(turn / 2 / math.pi)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, turn], axis=-1)


def square_root(cov: Float) -> Float:
    """Return B with B B' = cov and as many columns as the rank of cov."""
    sigma = np.sqrt(np.where(np.diag(cov) > 0, np.diag(cov), 1.0))
    value, axes = np.linalg.eigh(cov / np.outer(sigma, sigma))
    keep = value > 1e-12
    return sigma[:, None] * axes[:, keep] * np.sqrt(value[keep])


class ExactProblem:
    """Maximum a posteriori problem of a recording with known association."""

    def __init__(self, recording: Recording) -> None:
        assert recording.landmark is not None
        self.recording = recording
        self.ids, first, self.slot = np.unique(recording.landmark, return_index=True, return_inverse=True)
        self.roots = [square_root(recording.prior_cov), *map(square_root, recording.odometry_cov)]
        self.noises = sum(root.shape[1] for root in self.roots)
        self.whitener = np.linalg.inv(np.linalg.cholesky(recording.observation_cov))
        self._first = first

    def poses(self, unknowns: Float) -> Float:
        """Return the poses (..., N+1, 3)."""
        pose = np.broadcast_to(self.recording.prior_mean, (*unknowns.shape[:-1], 3))
        poses, begin = [], 0
        for k, root in enumerate(self.roots):
            if k > 0:
                pose = compose(pose, self.recording.odometry[k - 1])
            end = begin + root.shape[1]
            pose = compose(pose, exp_se2(unknowns[..., begin:end] @ root.T))
            poses.append(pose)
            begin = end
        return np.stack(poses, axis=-2)

    def landmarks(self, unknowns: Float) -> Float:
        """Return the landmarks (..., L, 2)."""
        return unknowns[..., self.noises :].reshape(*unknowns.shape[:-1], -1, 2)

    def residuals(self, unknowns: Float) -> Float:
        """Return the residuals (..., noises + 2M), of unit variance."""
        pose = self.poses(unknowns)[..., self.recording.observation_step, :]
        offset = self.landmarks(unknowns)[..., self.slot, :] - pose[..., :2]
        delta = np.einsum("...ji,...j->...i", rotation(pose[..., 2]), offset)
        if self.recording.sensor == "position":
            error = delta - self.recording.observation
        else:
            distance, bearing = np.hypot(delta[..., 0], delta[..., 1]), np.arctan2(delta[..., 1], delta[..., 0])
            z = self.recording.observation
            error = np.stack([distance - z[:, 0], wrap(bearing - z[:, 1])], axis=-1)
        white = np.einsum("mij,...mj->...mi", self.whitener, error)
        return np.concatenate([unknowns[..., : self.noises], white.reshape(*unknowns.shape[:-1], -1)], axis=-1)

    def jacobian(self, unknowns: Float) -> Float:
        return _differences(self.residuals, unknowns)

    def start(self, noise: Float | None = None) -> Float:
        """Return unknowns with these noise coordinates (zero if None) and landmarks at their first observation."""
        unknowns = np.zeros(self.noises + 2 * len(self.ids))
        if noise is not None:
            unknowns[: self.noises] = noise
        pose = self.poses(unknowns)[self.recording.observation_step[self._first]]
        z = self.recording.observation[self._first]
        if self.recording.sensor == "range-bearing":
            z = z[:, :1] * np.column_stack([np.cos(z[:, 1]), np.sin(z[:, 1])])
        seen = np.column_stack([z, np.zeros(len(z))])
        unknowns[self.noises :] = compose(pose, seen)[:, :2].ravel()
        return unknowns

    def solve(self, start: Float) -> Float:
        """Return the minimum near `start` by Levenberg-Marquardt steps and then full Gauss-Newton steps."""
        unknowns = least_squares(
            self.residuals,
            start,
            self.jacobian,  # a callable is documented
            method="lm",
        ).x
        for _ in range(50):
            step = np.linalg.lstsq(self.jacobian(unknowns), -self.residuals(unknowns))[0]
            unknowns = unknowns + step
            if np.abs(step).max() < 1e-8:
                return unknowns
        raise AssertionError("the reference itself found no minimum")

    def cost(self, unknowns: Float) -> float:
        return 0.5 * float(np.sum(self.residuals(unknowns) ** 2))

    def covariances(self, unknowns: Float) -> tuple[Float, Float]:
        """Return covariances of poses (N+1, 3, 3) in additive world coordinates, and of landmarks (L, 2, 2)."""
        root = np.linalg.inv(np.linalg.qr(self.jacobian(unknowns))[1])
        to_poses = _differences(lambda u: self.poses(u).reshape(*u.shape[:-1], -1), unknowns, headings=3)
        spread = (to_poses @ root).reshape(-1, 3, len(unknowns))
        own = root[self.noises :].reshape(-1, 2, len(unknowns))
        return spread @ spread.swapaxes(1, 2), own @ own.swapaxes(1, 2)


def _differences(function: Callable[[Float], Float], at: Float, step: float = 3e-4, headings: int = 0) -> Float:
    """Compute the Jacobian by fourth-order central differences; every `headings`-th result is an angle (0: none)."""
    offsets = step * np.eye(len(at))
    near = function(at + offsets) - function(at - offsets)
    far = function(at + 2 * offsets) - function(at - 2 * offsets)
    if headings:
        angle = slice(headings - 1, None, headings)
        near[:, angle], far[:, angle] = wrap(near[:, angle]), wrap(far[:, angle])
    return (8 * near - far).T / (12 * step)
