"""As noise vanishes every estimator tends to the optimum: one linear problem is left, and all solve it.

What separates them is of second order in the noise, so in standard deviations it falls in proportion to
it. GTSAM takes a motion's covariance in the frame at the end of the increment, the filters at its start;
covariances here are isotropic in x and y, for which that is the same.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, riekf, riukf, robocentric_ekf
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording

Estimator = Callable[[Recording], Estimate]
LEVELS = (1e-2, 1e-3, 1e-4)


class Distance(NamedTuple):
    """From the optimum, at the end: of the pose and the landmarks in sigmas, and of the pose's sigmas as a ratio."""

    pose: float
    landmarks: float
    sigmas: float


@functools.cache
def recording_of(seed: int, sensor: str, noise: float) -> Recording:
    """The same random numbers at every noise level."""
    _, recording = random_recording(seed, sensor=sensor, noise=noise)
    isotropic = np.diag([0.03, 0.03, 0.01]) ** 2 * noise**2
    return replace(recording, odometry_cov=np.tile(isotropic, (recording.steps, 1, 1)))


def ends(estimate: Estimate) -> tuple[Float, Float, Float, Float]:
    """Last pose and its sigmas, landmarks in increasing id order and their sigmas."""
    assert estimate.pose_covs is not None
    assert estimate.landmark_covs is not None
    order = np.argsort(estimate.landmark_ids)
    landmark_sigmas = np.sqrt(np.diagonal(estimate.landmark_covs[order], axis1=1, axis2=2))
    return estimate.poses[-1], np.sqrt(np.diag(estimate.pose_covs[-1])), estimate.landmarks[order], landmark_sigmas


def distance(estimate: Estimate, optimum: Estimate) -> Distance:
    pose, sigma, landmarks, _ = ends(estimate)
    best_pose, best_sigma, best_landmarks, best_landmark_sigma = ends(optimum)
    apart = pose - best_pose
    apart[2] = wrap(apart[2])
    return Distance(
        float(np.abs(apart / best_sigma).max()),
        float(np.abs((landmarks - best_landmarks) / best_landmark_sigma).max()),
        float(np.abs(sigma / best_sigma - 1).max()),
    )


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("estimator", [ekf_slam, riekf, riukf, robocentric_ekf])
def test_the_distance_to_the_optimum_falls_with_the_noise(estimator: Estimator, seed: int, sensor: str) -> None:
    """Ten times less noise, ten times nearer in sigmas: measured ratios are 9.6 to 10.2."""
    recordings = [recording_of(seed, sensor, noise) for noise in LEVELS]
    distances = np.array([distance(estimator(recording), batch(recording)) for recording in recordings])
    np.testing.assert_allclose(distances[:-1] / distances[1:], 10.0, rtol=0.05)
    assert distances[-1].max() < 2e-4


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("noise", LEVELS)
def test_the_causal_optimum_is_there_at_any_noise(noise: float, sensor: str) -> None:
    for seed in range(3):
        recording = recording_of(seed, sensor, noise)
        assert max(distance(causal(recording), batch(recording))) < 0.003


def test_the_frame_of_the_motions_noise_is_what_keeps_them_apart() -> None:
    """With anisotropic motion noise filter and GTSAM differ however small the noise: the proof that it matters."""
    apart: list[float] = []
    for noise in LEVELS:
        recording = recording_of(0, "range-bearing", noise)
        slender = np.diag([0.03, 0.003, 0.01]) ** 2 * noise**2
        recording = replace(recording, odometry_cov=np.tile(slender, (recording.steps, 1, 1)))
        apart.append(distance(riekf(recording), batch(recording)).pose)
    np.testing.assert_allclose(apart, apart[0], rtol=0.05)
    assert min(apart) > 0.01
