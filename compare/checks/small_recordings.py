"""Small worlds with a known answer: a path, landmarks and sights, from which a recording is made.

The robot moves forward and turns, as the practical's does: no increment and no noise sideways. Ids count the landmarks
in the order of their first sight unless a law is about ids. Sigmas of sights are small, so that all filters of first
order agree, and where a law needs something as good as known, its sigma is `KNOWN`: smaller still by a thousand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.sensors import predict

SIGMA = 1e-4  # of ranges [m] and bearings [rad]: at 5 m a filter of first order errs by some 1e-4 of that
KNOWN = 1e-7  # of a start as good as known [m], [rad]; not zero, which some filters cannot invert
KNOWN_START = KNOWN**2 * np.eye(3)

Sights = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True)
class World:
    """A path among landmarks.

    Attributes:
        start: (3,) true start pose, which is the prior's mean.
        prior_cov: (3, 3).
        moves: (N, 2) forward [m] and turn [rad] of each step.
        move_sigmas: (N, 2) their sigmas as estimators assume them; the moves themselves are exact.
        landmarks: (L, 2) [m].
        sights: (step, landmark), in order of step.
        step_s: time between poses [s].
    """

    start: Float
    prior_cov: Float
    moves: Float
    move_sigmas: Float
    landmarks: Float
    sights: Sights
    step_s: float = 1.0

    @property
    def increments(self) -> Float:
        """(N, 3) in the body frame."""
        return np.column_stack([self.moves[:, 0], np.zeros(len(self.moves)), self.moves[:, 1]])

    @property
    def poses(self) -> Float:
        """(N+1, 3) the true path."""
        return chain(self.start, self.increments)

    def recording(self, disturbance: Float | None = None, sigma: float = SIGMA) -> Recording:
        """Exact ranges and bearings plus `disturbance` (M, 2), with that sigma [m], [rad] as estimators assume it."""
        steps, names = np.array(self.sights, dtype=np.int64).reshape(-1, 2).T
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
            observation_cov=np.tile(sigma**2 * np.eye(2), (len(names), 1, 1)),
            landmark=names,
        )


def standing(start: Float, prior_cov: Float, landmarks: Float, sights: Sights) -> World:
    """A robot that stands still until the last sight, and knows it."""
    still = np.zeros((max(step for step, _ in sights), 2))
    return World(start=start, prior_cov=prior_cov, moves=still, move_sigmas=still, landmarks=landmarks, sights=sights)


def around(pose: Float, distance: Float, bearing: Float) -> Float:
    """Landmarks (L, 2) at those distances (L,) [m] and bearings (L,) [rad] from a pose."""
    direction = pose[2] + bearing
    return pose[:2] + np.column_stack([distance * np.cos(direction), distance * np.sin(direction)])


def any_start(rng: np.random.Generator) -> Float:
    """A start (3,) off the origin that looks away from all axes of the world, and from the cut at pi."""
    return np.append(rng.uniform(-3.0, 3.0, 2), rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.1))


def correlated(sigmas: Float, rng: np.random.Generator) -> Float:
    """A covariance (n, n) of those sigmas (n,) with correlations of 0.4, their signs drawn."""
    signs = rng.choice([-1.0, 1.0], len(sigmas))
    correlation = 0.6 * np.eye(len(sigmas)) + 0.4 * np.outer(signs, signs)
    return np.diag(sigmas) @ correlation @ np.diag(sigmas)


def relative_error(cov: Float, right: Float) -> float:
    """The largest difference of two covariances (..., n, n), every entry in the sigmas of the right one."""
    sigmas = np.sqrt(np.diagonal(right, axis1=-2, axis2=-1))
    return float(np.abs((cov - right) / (sigmas[..., :, None] * sigmas[..., None, :])).max())


def pose_error(poses: Float, right: Float) -> float:
    """The largest difference of two paths (..., 3), metres and radians alike."""
    difference = poses - right
    difference[..., 2] = wrap(difference[..., 2])
    return float(np.abs(difference).max())
