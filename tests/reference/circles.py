"""Many runs on a circle, and chi-square bounds for consistent filters.

Bounds are two-sided. A filter with exact chi-square statistics fails a test (all its bounds together) once in 1000.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.ekf import OnlineFilter
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import chain, compose, rotation, wrap
from slamgauge.sensors import Sensor

Estimator = Callable[[Recording], Estimate]
FALSE_ALARM_RATE = 1e-3
J = np.array([[0.0, -1.0], [1.0, 0.0]])
RUNS, STEPS = 100, 80


def covs_of(estimate: Estimate) -> Float:
    assert estimate.pose_covs is not None
    return estimate.pose_covs


def circling(seed: int, sensor: Sensor, heading_sigma: float) -> tuple[Float, Recording]:
    """Simulate two turns of a circle with eight landmarks 2 m outside it, with the start drawn from the prior.

    Noise is correlated and has the covariance of the recording. No landmark comes near the robot.
    """
    rng = np.random.default_rng(seed)
    commands = np.tile([0.5, 0.0, 2 * math.pi / 40], (STEPS, 1))
    radius = 0.5 * 40 / (2 * math.pi)
    start = np.array([0.0, 0.0, 0.8])
    prior_cov = np.diag([0.1, 0.1, heading_sigma]) ** 2
    poses = chain(rng.multivariate_normal(start, prior_cov), commands)
    angle = np.arange(8) * math.pi / 4
    landmarks = compose(start, [0, radius, 0])[:2] + (radius + 2) * np.column_stack([np.cos(angle), np.sin(angle)])
    offset = landmarks - poses[:, None, :2]
    step, landmark = np.nonzero(np.linalg.norm(offset, axis=2) < 4)
    delta = np.einsum("mji,mj->mi", rotation(poses[step, 2]), offset[step, landmark])
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
    exact, sigmas = (delta, [0.1, 0.1]) if sensor == "position" else (polar, [0.1, 0.03])
    motion_root = np.array([[0.02, 0.0, 0.0], [0.004, 0.01, 0.0], [0.002, 0.002, 0.01]])
    return poses, Recording(
        stamps=np.arange(STEPS + 1.0),
        prior_mean=start,
        prior_cov=prior_cov,
        odometry=commands + rng.normal(size=(STEPS, 3)) @ motion_root.T,
        odometry_cov=np.tile(motion_root @ motion_root.T, (STEPS, 1, 1)),
        sensor=sensor,
        observation_step=step,
        observation=exact + rng.normal(size=exact.shape) * sigmas,
        observation_cov=np.tile(np.diag(sigmas) ** 2, (len(step), 1, 1)),
        landmark=landmark,
    )


def run_all(
    estimator: Estimator, sensor: Sensor, heading_sigma: float, runs: int = RUNS
) -> list[tuple[Float, Estimate]]:
    recordings = [circling(seed, sensor, heading_sigma) for seed in range(runs)]
    return [(truth, estimator(recording)) for truth, recording in recordings]


def outside(total: Float, dof: int, tests: int) -> int:
    """Count the sums outside their two-sided band; one of `tests` sums is outside by chance once in 1000 tests."""
    tail = FALSE_ALARM_RATE / 2 / tests
    return int(np.sum((total < chi2.ppf(tail, dof)) | (total > chi2.isf(tail, dof))))


def additive_nees(truth: Float, estimate: Estimate) -> Float:
    """Return the squared Mahalanobis distance (N+1,) of the additive pose error."""
    error = truth - estimate.poses
    error[:, 2] = wrap(error[:, 2])
    return np.einsum("ki,kij,kj->k", error, np.linalg.inv(covs_of(estimate)), error)


def invariant_nees(truth: Float, estimate: Estimate) -> Float:
    """Return the same (N+1,) for the right-invariant error xi: theta = theta^ + xi_t, p = R(xi_t) p^ + V(xi_t) xi_p."""
    turn = wrap(truth[:, 2] - estimate.poses[:, 2])
    left = truth[:, :2] - np.einsum("kij,kj->ki", rotation(turn), estimate.poses[:, :2])
    cosine = np.sinc(turn / math.pi)
    sine = np.sin(turn / 2) * np.sinc(turn / 2 / math.pi)
    V = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    xi = np.column_stack([np.linalg.solve(V, left[..., None])[..., 0], turn])
    D = np.tile(np.eye(3), (len(truth), 1, 1))
    D[:, :2, 2] = estimate.poses[:, :2] @ J.T
    return np.einsum("ki,kij,kj->k", xi, D.swapaxes(1, 2) @ np.linalg.inv(covs_of(estimate)) @ D, xi)


def back_and_forth(slam: OnlineFilter, steps: int) -> Iterator[int]:
    """Move a filter back and forth without slip, six landmarks in view; yield the number of each step."""
    rng = np.random.default_rng(0)
    positions = rng.uniform(-8, 8, (6, 2))
    values = np.column_stack([np.hypot(*positions.T), np.arctan2(positions[:, 1], positions[:, 0])])
    covs = np.tile(np.diag([0.1, np.deg2rad(5)]) ** 2, (6, 1, 1))
    for k in range(steps):
        slam.predict([0.1 if k % 2 else -0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        slam.update(Observations(np.arange(6), values + rng.normal(size=values.shape) * [0.1, np.deg2rad(5)], covs))
        yield k
