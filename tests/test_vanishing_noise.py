"""With vanishing noise every estimator approaches the optimum, because all solve the same linear problem.

Their differences are of second order in the noise, so in standard deviations they are proportional to it. GTSAM takes
the covariance of a motion in the frame at the end of the increment, filters in the frame at its start. Covariances here
are isotropic in x and y, so that both are the same.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, riekf
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

Estimator = Callable[[Recording], Estimate]
LEVELS = (1e-2, 1e-3, 1e-4)


@functools.cache
def recording_of(seed: int, sensor: str, noise: float) -> Recording:
    """Return a recording with the same random numbers at every noise level."""
    _, recording = random_recording(seed, sensor=sensor, noise=noise)
    isotropic = np.diag([0.03, 0.03, 0.01]) ** 2 * noise**2
    return replace(recording, odometry_cov=np.tile(isotropic, (recording.steps, 1, 1)))


def end(estimate: Estimate) -> tuple[Float, Float]:
    """Return the last pose and the landmarks in the order of ids as one vector (3 + 2 L,), and its sigmas."""
    assert estimate.pose_covs is not None and estimate.landmark_covs is not None
    order = np.argsort(estimate.landmark_ids)
    variances = np.diagonal(estimate.landmark_covs[order], axis1=1, axis2=2)
    state = np.concatenate([estimate.poses[-1], estimate.landmarks[order].ravel()])
    return state, np.sqrt(np.concatenate([np.diag(estimate.pose_covs[-1]), variances.ravel()]))


def distance(estimate: Estimate, optimum: Estimate) -> Float:
    """Return distances (3,) at the end: pose and landmarks in sigmas, and relative difference of the pose's sigmas."""
    (state, sigma), (best, best_sigma) = end(estimate), end(optimum)
    apart = state - best
    apart[2] = wrap(apart[2])
    away = np.abs(apart / best_sigma)
    return np.array([away[:3].max(), away[3:].max(), np.abs(sigma / best_sigma - 1)[:3].max()])


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("estimator", [ekf_slam, riekf])
def test_the_distance_to_the_optimum_falls_with_the_noise(estimator: Estimator, seed: int, sensor: str) -> None:
    """With a tenth of the noise the distance in sigmas is a tenth: measured ratios are 9.6 to 10.2."""
    recordings = [recording_of(seed, sensor, noise) for noise in LEVELS]
    distances = np.array([distance(estimator(recording), batch(recording)) for recording in recordings])
    np.testing.assert_allclose(distances[:-1] / distances[1:], 10.0, rtol=0.05)
    assert distances[-1].max() < 2e-4


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("noise", LEVELS)
def test_causal_agrees_with_batch_at_any_noise(noise: float, sensor: str) -> None:
    for seed in range(3):
        recording = recording_of(seed, sensor, noise)
        assert distance(causal(recording), batch(recording)).max() < 0.003


def test_filter_and_graph_differ_if_motion_noise_is_anisotropic() -> None:
    """The frames of the motion noise differ, so the distance in sigmas does not fall with the noise."""
    apart: list[float] = []
    for noise in LEVELS:
        recording = recording_of(0, "range-bearing", noise)
        slender = np.diag([0.03, 0.003, 0.01]) ** 2 * noise**2
        recording = replace(recording, odometry_cov=np.tile(slender, (recording.steps, 1, 1)))
        apart.append(distance(riekf(recording), batch(recording))[0])
    np.testing.assert_allclose(apart, apart[0], rtol=0.05)
    assert min(apart) > 0.01
