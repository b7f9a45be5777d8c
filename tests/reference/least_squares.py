"""The optimum by dense least squares with MINPACK, independent of GTSAM and of the project's solvers.

Unknowns are the landmarks and unit-variance coordinates a, w_k of the noise of the start and of each motion:
x_0 = mean Exp(B_0 a), x_k = x_{k-1} u_k Exp(B_k w_k) with B B' = Q. A direction without variance has no unknown, so
singular noise is exact. The model is that of the graph: Log(u^-1 between) ~ N(0, Q).

Let g_j (3, r_j) be the effect of noise j on pose j in the world frame. A landmark l moves by -R'[I, J (l - p_j)] g_j in
the body frame of any later pose: every Jacobian has a closed form without sums along the path.

All positions are relative to the prior's mean, so that no digits are lost far from the origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, pose_rotation, right_jacobian, rotation, wrap
from tests.reference.given import given

ARRIVED = 1e-8  # length of a step [standard deviations], over all unknowns
EVALUATIONS = 400  # most evaluations of the residuals
NEWTON_STEPS = 10


class Minimum(NamedTuple):
    """A minimum, and the length in sigmas of the next undamped step from there."""

    unknowns: Float
    cost: float
    distance: float


class NoMinimumError(Exception):
    """The solver ended at a point with a gradient that does not vanish."""


def exp_se2(tangent: Float) -> Float:
    """Return the exponential (..., 3) of SE(2), independent of the project's."""
    x, y, turn = np.moveaxis(tangent, -1, 0)
    cosine, sine = np.sinc(turn / np.pi), np.sin(turn / 2) * np.sinc(turn / 2 / np.pi)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, turn], axis=-1)


def square_root(cov: Float) -> Float:
    """Return B with B B' = cov and as many columns as the rank of cov."""
    sigma = np.sqrt(np.where(np.diag(cov) > 0, np.diag(cov), 1.0))
    value, axes = np.linalg.eigh(cov / np.outer(sigma, sigma))
    keep = value > 1e-12
    return sigma[:, None] * axes[:, keep] * np.sqrt(value[keep])


class Model:
    """Maximum a posteriori problem of a recording with known association, with the prior's mean as origin."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.origin = recording.prior_mean[:2].copy()
        self.ids, self.first, self.slot = np.unique(given(recording.landmark), return_index=True, return_inverse=True)
        turn = pose_rotation(recording.prior_mean[2])
        covs = [turn.T @ recording.prior_cov @ turn, *recording.odometry_cov]
        self.roots = np.zeros((len(covs), 3, 3))  # padded with columns of zeros
        self.free = np.zeros((len(covs), 3), dtype=bool)
        for root, free, cov in zip(self.roots, self.free, covs, strict=True):
            columns = square_root(cov)
            root[:, : columns.shape[1]], free[: columns.shape[1]] = columns, True
        self.noises = int(self.free.sum())
        self.whitener = np.linalg.inv(np.linalg.cholesky(recording.observation_cov))
        self._at = recording.observation_step
        self._increments = np.concatenate([[[0.0, 0.0, recording.prior_mean[2]]], recording.odometry])

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.noises + 2 * len(self.ids)

    def tangents(self, unknowns: Float) -> Float:
        """Return the noise (N+1, 3) of start and motions in the body frame."""
        noise = np.zeros(self.free.shape)
        noise[self.free] = unknowns[: self.noises]
        return np.einsum("nij,nj->ni", self.roots, noise)

    def poses(self, unknowns: Float) -> Float:
        """Return poses (N+1, 3) relative to the origin."""
        steps = compose(self._increments, exp_se2(self.tangents(unknowns)))
        headings = np.cumsum(steps[:, 2])
        moves = np.einsum("nij,nj->ni", rotation(np.concatenate([[0.0], headings[:-1]])), steps[:, :2])
        return np.column_stack([np.cumsum(moves, axis=0), wrap(headings)])

    def landmarks(self, unknowns: Float) -> Float:
        """Return landmarks (L, 2) relative to the origin, in the order of `ids`."""
        return unknowns[self.noises :].reshape(-1, 2)

    def residuals(self, unknowns: Float) -> Float:
        """Return the residuals (noises + dM,), of unit variance."""
        error = self._observed(self.poses(unknowns), self.landmarks(unknowns))[0]
        white = np.einsum("mij,mj->mi", self.whitener, error)
        return np.concatenate([unknowns[: self.noises], white.ravel()])

    def _observed(self, poses: Float, landmarks: Float) -> tuple[Float, Float]:
        """Return errors h - z (M, d), and Jacobians (M, d, 2) of h by the landmark in the world frame."""
        recording, pose = self.recording, poses[self._at]
        to_body = rotation(pose[:, 2]).swapaxes(1, 2)
        delta = np.einsum("mij,mj->mi", to_body, landmarks[self.slot] - pose[:, :2])
        if recording.sensor == "position":
            return delta - recording.observation, to_body
        distance = np.maximum(np.hypot(*delta.T), 1e-12)
        rows = slice(2 - recording.observation.shape[1], 2)  # bearing only, or range and bearing
        predicted = np.column_stack([distance, np.arctan2(delta[:, 1], delta[:, 0])])[:, rows]
        error = predicted - recording.observation
        error[:, -1] = wrap(error[:, -1])
        along = delta / distance[:, None]
        across = np.column_stack([-along[:, 1], along[:, 0]]) / distance[:, None]
        return error, np.stack([along, across], axis=1)[:, rows] @ to_body

    def jacobian(self, unknowns: Float) -> Float:
        """Return the Jacobian (noises + dM, size) of the residuals."""
        poses, landmarks = self.poses(unknowns), self.landmarks(unknowns)
        H = self.whitener @ self._observed(poses, landmarks)[1]
        count, dim = H.shape[:2]
        effects = self._effects(poses, unknowns)
        lever = landmarks[self.slot][:, None] - poses[None, :, :2]
        lever = np.stack([-lever[:, :, 1], lever[:, :, 0]], axis=-1)  # J (l - p_j) (M, N+1, 2)
        moved = effects[None, :, :2] + lever[..., None] * effects[None, :, 2:]
        moved[self._at[:, None] < np.arange(len(poses))] = 0.0
        by_noise = -np.einsum("mdi,mnir->mdnr", H, moved)[:, :, self.free]
        full = np.zeros((self.noises + count * dim, self.size))
        full[: self.noises, : self.noises] = np.eye(self.noises)
        full[self.noises :, : self.noises] = by_noise.reshape(count * dim, self.noises)
        by_landmark = full[self.noises :, self.noises :].reshape(count, dim, len(self.ids), 2)
        by_landmark[np.arange(count), :, self.slot] = H
        return full

    def _effects(self, poses: Float, unknowns: Float) -> Float:
        """Return the effect g (N+1, 3, 3) of each noise on its own pose in the world frame."""
        tangents = self.tangents(unknowns)
        end = np.concatenate([[0.0], poses[:-1, 2]]) + self._increments[:, 2] + tangents[:, 2]
        return pose_rotation(end) @ right_jacobian(tangents) @ self.roots

    def covariances(self, unknowns: Float) -> tuple[Float, Float]:
        """Return additive covariances of poses (N+1, 3, 3) and landmarks (L, 2, 2)."""
        factor = self.factored(unknowns)[0]
        pose_covs = [self.pose_cov(step, unknowns, factor) for step in range(len(self.free))]
        root = solve_triangular(factor, np.eye(self.size))[self.noises :].reshape(-1, 2, self.size)
        return np.array(pose_covs), root @ root.swapaxes(1, 2)

    def pose_cov(self, step: int, unknowns: Float, factor: Float) -> Float:
        """Return the additive covariance (3, 3) of a pose from the factor R of the information R'R."""
        poses = self.poses(unknowns)
        effects = self._effects(poses, unknowns)
        effects[step + 1 :] = 0.0  # later noise does not move the pose
        lever = poses[step, :2] - poses[:, :2]
        effects[:, 0] -= lever[:, 1:] * effects[:, 2]
        effects[:, 1] += lever[:, :1] * effects[:, 2]
        by_unknown = np.zeros((3, self.size))
        by_unknown[:, : self.noises] = np.moveaxis(effects, 1, 0)[:, self.free]
        spread = solve_triangular(factor.T, by_unknown.T, lower=True)
        return spread.T @ spread

    def unknowns(self, poses: Float, landmarks: Float) -> Float:
        """Return the unknowns at relative poses (N+1, 3) and landmarks (L, 2), without motion that no noise allows."""
        before = np.concatenate([np.zeros((1, 3)), poses[:-1]])
        tangents = _log_se2(between(compose(before, self._increments), poses))
        noise = np.einsum("nij,nj->ni", np.linalg.pinv(self.roots), tangents)
        return np.concatenate([noise[self.free], landmarks.ravel()])

    def world(self, poses: Float) -> Float:
        """Return relative poses (..., 3) or points (..., 2) in the world frame."""
        moved = poses.copy()
        moved[..., :2] += self.origin
        return moved

    def relative(self, poses: Float) -> Float:
        """Return world poses (..., 3) or points (..., 2) relative to the origin."""
        moved = np.array(poses, dtype=np.float64)
        moved[..., :2] -= self.origin
        return moved

    def start(self, poses: Float) -> Float:
        """Return the unknowns at relative poses (N+1, 3) and landmarks computed from observations at these poses."""
        return self.drawn_start(self.unknowns(poses, np.zeros((len(self.ids), 2)))[: self.noises])

    def drawn_start(self, noise: Float) -> Float:
        """Return unknowns with these noise coordinates (noises,), and landmarks computed from observations."""
        bare = np.concatenate([noise, np.zeros(2 * len(self.ids))])
        return np.concatenate([noise, self.sighted(self.poses(bare)).ravel()])

    def sighted(self, poses: Float) -> Float:
        """Return landmarks (L, 2) computed from relative poses (N+1, 3): first observations, or crossing bearings."""
        z = self.recording.observation
        if self.recording.sensor == "bearing":
            crossed = [self._crossed(poses, np.flatnonzero(self.slot == s)) for s in range(len(self.ids))]
            return np.array(crossed).reshape(-1, 2)
        if self.recording.sensor == "range-bearing":
            z = z[:, :1] * np.column_stack([np.cos(z[:, 1]), np.sin(z[:, 1])])
        seen = np.column_stack([z, np.zeros(len(z))])[self.first]
        return compose(poses[self._at[self.first]], seen)[:, :2].reshape(-1, 2)

    def _crossed(self, poses: Float, rows: Int) -> Float:
        """Return the point (2,) nearest to the lines of bearing; ahead of the middle pose where they hardly cross."""
        seen_from = poses[self._at[rows]]
        angle = seen_from[:, 2] + self.recording.observation[rows, 0]
        normal = np.column_stack([-np.sin(angle), np.cos(angle)])
        ahead = seen_from[len(rows) // 2, :2] + 4.0 * np.array(
            [np.cos(angle[len(rows) // 2]), np.sin(angle[len(rows) // 2])]
        )
        held = 1e-4 * np.eye(2)
        information = normal.T @ normal + held
        return np.linalg.solve(information, normal.T @ np.sum(normal * seen_from[:, :2], axis=1) + held @ ahead)

    def cost(self, unknowns: Float) -> float:
        """Return half the sum of squared residuals."""
        residuals = self.residuals(unknowns)
        return 0.5 * float(residuals @ residuals)

    def factored(self, unknowns: Float) -> tuple[Float, Float]:
        """Return R (size, size) of the Jacobian J = QR, and Q'r (size,)."""
        stacked = np.column_stack([self.jacobian(unknowns), self.residuals(unknowns)])
        if len(stacked) < self.size:
            raise NoMinimumError("fewer observations than unknowns")
        factor = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
        return factor[: self.size, : self.size], factor[: self.size, -1]

    def minimum(self, start: Float, evaluations: int = EVALUATIONS) -> Minimum:
        """Take MINPACK's Levenberg-Marquardt steps from `start`, then Gauss-Newton steps until they are negligible.

        Raises:
            NoMinimumError: the next step would be longer than a thousandth of a sigma.
        """
        at = least_squares(
            self.residuals, start, self.jacobian, method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=evaluations
        ).x
        best, distance = at, np.inf
        for _ in range(NEWTON_STEPS):
            R, projected = self.factored(at)
            length = float(np.linalg.norm(projected))
            if length < distance:
                best, distance = at, length
            if distance < ARRIVED or length > distance or not np.diag(R).all():
                break
            at = at - solve_triangular(R, projected)
        if not distance < 1e-3:
            raise NoMinimumError(f"the next step has {distance:.1e} sigma")
        return Minimum(best, self.cost(best), distance)


def placed_only(recording: Recording, ids: Int) -> Recording:
    """Return the recording with the observations of the landmarks `ids` only."""
    return recording.only(np.isin(given(recording.landmark), ids))


def _log_se2(increment: Float) -> Float:
    """Return the tangents (n, 3) of increments (n, 3): the inverse of Exp."""
    x, y, t = increment.T
    s, c = np.sinc(t / np.pi), np.sin(t / 2) * np.sinc(t / 2 / np.pi)
    squared = s**2 + c**2
    return np.column_stack([(s * x + c * y) / squared, (s * y - c * x) / squared, t])
