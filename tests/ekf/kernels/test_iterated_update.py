"""The iterated update: one pass is the EKF, many passes end at the minimum."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import SlamFilter
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.iterated_update import iterate
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.ekf.maps.correction_table import WHOLE_SCAN, Rule
from slamgauge.recording import Observations
from slamgauge.se2 import rotation
from tests.reference.jacobians import differentiate
from tests.reference.random_recordings import random_recording

SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])


@SENSORS
def test_one_iteration_is_the_ekf(sensor: str) -> None:
    """One pass equals the EKF to rounding; many passes differ."""
    _, recording = random_recording(7, sensor=sensor, steps=60)

    def single_pass(code: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
        return iterate(code, belief, count, work, 1)

    finals = []
    for rule in ("standard", Rule(single_pass, block=WHOLE_SCAN), "iterated"):
        slam = SlamFilter(sensor, recording.prior_mean, recording.prior_cov, rule)
        assert len([*drive(slam, recording)]) == recording.steps + 1
        finals.append((slam.pose, slam.landmarks, slam.cov))
    for actual, expected, iterated in zip(finals[1], finals[0], finals[2], strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-13)
        assert np.abs(iterated - expected).max() > 1e-9


def test_a_linear_problem_needs_one_pass() -> None:
    """A known heading makes the position sensor linear: the solution is the weighted mean."""
    prior = np.diag([0.04, 0.04, 0.0])
    covs = np.diag([0.01, 0.01])[None]
    finals = []
    for correction in ("standard", "iterated"):
        slam = SlamFilter("position", np.zeros(3), prior, correction)
        slam.update(Observations(np.array([0]), np.array([[2.0, 1.0]]), covs))
        slam.predict([0.5, 0.0, 0.0], np.diag([0.09, 0.01, 0.0]))
        slam.update(Observations(np.array([0]), np.array([[1.2, 1.1]]), covs))
        finals.append((slam.pose, slam.landmarks[0], slam.cov))
    for actual, expected in zip(finals[1], finals[0], strict=True):
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-15)
    # x: observed at 0.5 + 1.2, expected at 2.0; the motion takes 0.09 / 0.11 of the difference -0.3
    np.testing.assert_allclose(finals[0][0], [0.5 + 0.3 * 0.09 / 0.11, -0.1 * 0.01 / 0.03, 0.0], atol=1e-15)


def test_iteration_ends_at_the_minimum_of_prior_and_observations() -> None:
    """The gradient of the cost is zero there, and not zero at the standard update."""
    prior = np.diag([0.3, 0.3, 0.1]) ** 2
    covs = np.tile(np.diag([0.05, 0.02]) ** 2, (2, 1, 1))
    sights = np.array([[1.5, 0.2], [1.2, -0.9]]), np.array([[1.3, 0.5], [1.4, -0.5]])
    gradients = []
    for correction in ("standard", "iterated"):
        slam = SlamFilter("range-bearing", np.zeros(3), prior, correction)
        slam.update(Observations(np.arange(2), sights[0], covs))
        slam.predict([0.3, 0.0, 0.3], np.diag([0.3, 0.2, 0.2]) ** 2)
        mean, cov = np.concatenate([slam.pose, slam.landmarks.ravel()]), slam.cov
        slam.update(Observations(np.arange(2), sights[1], covs))
        at = np.concatenate([slam.pose, slam.landmarks.ravel()])

        def cost(x: Float, mean: Float = mean, cov: Float = cov) -> Float:
            delta = (x[3:].reshape(2, 2) - x[:2]) @ rotation(x[2])
            seen = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
            residual = (sights[1] - seen) / [0.05, 0.02]
            return np.array([0.5 * (x - mean) @ np.linalg.solve(cov, x - mean) + 0.5 * (residual**2).sum()])

        gradients.append(np.abs(differentiate(cost, at, step=1e-4)).max())
    assert gradients[1] < 1e-5 < 1e-1 < gradients[0]
