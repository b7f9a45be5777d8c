"""Small worlds with a known answer, and their recordings.

The robot moves forward and turns, like that of the exercise: increments and noise have no lateral part. Ids number the
landmarks in the order of their first observation, except in checks of ids. Sigmas of observations are small, so that
all first-order filters agree. A quantity that a check treats as known has the sigma `KNOWN`, a thousand times smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.sensors import predict

SIGMA = 1e-4  # sigma of ranges [m] and bearings [rad]; the error of a first-order filter at 5 m is about 1e-4 of this
KNOWN = 1e-7  # sigma of a known start [m], [rad]; some filters cannot invert zero
KNOWN_START = KNOWN**2 * np.eye(3)

Observed = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True)
class World:
    """A path among landmarks."""

    moves: Float  # (N, 2) forward motion [m] and turn [rad] of each step
    move_sigmas: Float  # (N, 2) sigmas that estimators assume; the moves themselves are exact
    landmarks: Float = field(default_factory=lambda: np.zeros((0, 2)))  # (L, 2) [m]
    observed: Observed = ()  # step and landmark of each observation, steps in increasing order
    start: Float = field(default_factory=lambda: np.zeros(3))  # (3,) true start pose, the mean of the prior
    prior_cov: Float = field(default_factory=lambda: KNOWN_START)  # (3, 3)
    step_s: float = 1.0  # time between poses [s]
    is_arc: bool = False  # the robot turns while it moves, on an arc; by default it turns afterwards

    @property
    def increments(self) -> Float:
        """(N, 3) in the body frame."""
        return np.column_stack([self.moves[:, 0], np.zeros(len(self.moves)), self.moves[:, 1]])

    @property
    def poses(self) -> Float:
        """(N+1, 3) true path."""
        if not self.is_arc:
            return chain(self.start, self.increments)
        length, turn = self.moves.T
        along, across = length * np.sinc(turn / np.pi), length * np.sin(turn / 2) * np.sinc(turn / 2 / np.pi)
        return chain(self.start, np.column_stack([along, across, turn]))

    def recording(self, disturbance: Float | None = None, sigma: float | Float = SIGMA) -> Recording:
        """Return exact ranges and bearings plus `disturbance` (M, 2).

        Estimators assume `sigma` [m], [rad], one number or (M, 2).
        """
        steps, names = np.array(self.observed, dtype=np.int64).reshape(-1, 2).T
        poses, covs = self.poses[steps], np.zeros((len(self.moves), 3, 3))
        offset = np.einsum("mji,mj->mi", rotation(poses[:, 2]), self.landmarks[names] - poses[:, :2])
        seen = predict("range-bearing", offset)
        seen += 0.0 if disturbance is None else disturbance
        seen[:, 1] = wrap(seen[:, 1])
        covs[:, [0, 2], [0, 2]] = self.move_sigmas**2
        return Recording(
            stamps=self.step_s * np.arange(len(self.moves) + 1.0),
            prior_mean=self.start,
            prior_cov=self.prior_cov,
            odometry=self.increments,
            odometry_cov=covs,
            sensor="range-bearing",
            observation_step=steps,
            observation=seen,
            observation_cov=np.broadcast_to(sigma, (len(names), 2))[:, :, None] ** 2 * np.eye(2),
            landmark=names,
        )

    def noisy(self, rng: np.random.Generator, noise: float = SIGMA, sigma: float = SIGMA) -> Recording:
        """Return ranges and bearings with Gaussian noise; estimators assume `sigma`."""
        return self.recording(rng.normal(0.0, noise, (len(self.observed), 2)), sigma)


def at_rest(start: Float, prior_cov: Float, landmarks: Float, observed: Observed) -> World:
    """Return a world in which the robot does not move, with exact odometry."""
    rest = np.zeros((max(step for step, _ in observed), 2))
    return World(start=start, prior_cov=prior_cov, moves=rest, move_sigmas=rest, landmarks=landmarks, observed=observed)


def walk(rng: np.random.Generator, landmarks: Float, steps: int = 9, each: int = 1, turn: float = 0.0) -> World:
    """Return a walk from the origin along x with turns of ± `turn` [rad].

    Each scan observes the next `each` landmarks, and starts again after the last one.
    """
    turns = turn * np.array([1, -1, -1, 1, 1, -1, -1, 1, 1])[:steps]
    moves = np.column_stack([rng.uniform(0.3, 0.6, steps), turns])
    return World(
        prior_cov=correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng),
        moves=moves,
        move_sigmas=np.tile([10.0 * SIGMA, 5.0 * SIGMA], (steps, 1)),
        landmarks=landmarks,
        observed=tuple((step, (step * each + k) % len(landmarks)) for step in range(steps + 1) for k in range(each)),
    )


def ahead(rng: np.random.Generator) -> Float:
    """Return three landmarks (3, 2) that stay ahead of a walk from the origin along x."""
    return np.column_stack([rng.uniform(8.0, 10.0, 3), np.array([-5.0, 0.5, 6.0]) + rng.uniform(-0.5, 0.5, 3)])


def around(pose: Float, distance: Float, bearing: Float) -> Float:
    """Return landmarks (L, 2) at distances (L,) [m] and bearings (L,) [rad] from a pose."""
    direction = pose[2] + bearing
    return pose[:2] + np.column_stack([distance * np.cos(direction), distance * np.sin(direction)])


def any_start(rng: np.random.Generator) -> Float:
    """Return a start (3,) away from the origin, whose heading is far from the axes of the world and from pi."""
    return np.append(rng.uniform(-3.0, 3.0, 2), rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.1))


def correlated(sigmas: Float, rng: np.random.Generator) -> Float:
    """Return a covariance (n, n) with the given sigmas (n,) and correlations of 0.4 with random signs."""
    signs = rng.choice([-1.0, 1.0], len(sigmas))
    correlation = 0.6 * np.eye(len(sigmas)) + 0.4 * np.outer(signs, signs)
    return np.diag(sigmas) @ correlation @ np.diag(sigmas)


def relative_error(cov: Float, right: Float) -> float:
    """Return the largest difference of two covariances (..., n, n), each entry relative to the sigmas of `right`.

    Where a sigma is zero, equal entries differ by nothing and others by infinity.
    """
    sigmas, difference = np.sqrt(np.diagonal(right, axis1=-2, axis2=-1)), np.abs(cov - right)
    scale = np.broadcast_to(sigmas[..., :, None] * sigmas[..., None, :], difference.shape)
    with np.errstate(divide="ignore"):
        return float(np.divide(difference, scale, out=difference, where=difference != 0.0).max())


def pose_error(poses: Float, right: Float) -> float:
    """Return the largest difference of two paths (..., 3) [m, rad]."""
    difference = poses - right
    difference[..., 2] = wrap(difference[..., 2])
    return float(np.abs(difference).max())
