"""Small recordings, their optima, and comparison of two solutions."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, cost
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import Truth
from tests.reference.given import given
from tests.reference.random_recordings import random_recording


class Answer(NamedTuple):
    """Arrays of an estimate that all of these tests need."""

    poses: Float
    pose_covs: Float
    ids: Int
    landmarks: Float
    landmark_covs: Float


def answer(estimate: Estimate) -> Answer:
    """Return the arrays of an estimate with landmarks in the order of their ids."""
    order = np.argsort(estimate.landmark_ids)
    covs = given(estimate.landmark_covs)[order]
    return Answer(
        estimate.poses, given(estimate.pose_covs), estimate.landmark_ids[order], estimate.landmarks[order], covs
    )


@functools.cache
def problem(seed: int, sensor: str, slip: bool, fixed: bool = False) -> tuple[Truth, Recording]:
    sigmas = (0.0, 0.0, 0.0) if fixed else (0.1, 0.1, 0.02)
    return random_recording(seed, sensor=sensor, slip=slip, steps=25, landmarks=5, prior_sigmas=sigmas)


@functools.cache
def optimum(seed: int, sensor: str, slip: bool, fixed: bool = False) -> Answer:
    return answer(batch(problem(seed, sensor, slip, fixed)[1]))


def cost_of(recording: Recording, at: Answer) -> float:
    return cost(recording, at.poses, at.ids, at.landmarks)


def sigmas_of(covs: Float) -> Float:
    """Return standard deviations (n, d), 1 for a variance of zero, so that fixed values are compared directly."""
    variances = np.diagonal(covs, axis1=1, axis2=2)
    return np.sqrt(np.where(variances > 1e-30, variances, 1.0))


def pose_difference(poses: Float, reference: Answer) -> Float:
    """Return the differences (N+1, 3) in standard deviations of `reference`."""
    difference = poses - reference.poses
    difference[:, 2] = wrap(difference[:, 2])
    return difference / sigmas_of(reference.pose_covs)


def assert_same_covariances(actual: Float, expected: Float, tolerance: float) -> None:
    sigma = sigmas_of(expected)
    unit = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(actual / unit, expected / unit, rtol=0, atol=tolerance)


def one_observation_at_start(prior_mean: list[float], prior_cov: Float) -> Recording:
    return Recording(
        stamps=np.zeros(1),
        prior_mean=np.array(prior_mean),
        prior_cov=prior_cov,
        odometry=np.zeros((0, 3)),
        odometry_cov=np.zeros((0, 3, 3)),
        sensor="range-bearing",
        observation_step=np.zeros(1, dtype=np.int64),
        observation=np.array([[2.0, 0.3]]),
        observation_cov=np.diag([0.01, 0.01])[None],
        landmark=np.array([3]),
    )
