"""Compiled residuals: the series of the arc tangent, residuals, and gradients compared with differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem import residuals
from slamgauge.graph_baseline.problem.residuals import Measured, ObservationRow, measured_of
from slamgauge.se2 import between, log
from slamgauge.sensors import SENSORS
from tests.reference.jacobians import assert_jacobian
from tests.reference.random_recordings import recording_of

SMALL = [0.0, 1e-300, 1e-9, 1e-3, 0.0499, 0.0501]
ANGLES = [*SMALL, 0.7, 1.6, 3.0, math.pi]


@njit
def angle_of(along: float, across: float) -> float:
    return residuals.angle_of(along, across)


@njit
def observation_residual(
    sensor: int, observation: ObservationRow, turn: tuple[float, float], ex: float, ey: float
) -> tuple[float, float, float, float, float, float]:
    return residuals.observation_residual(sensor, observation, turn, ex, ey)


@njit
def observation_row(measured: Measured, row: int) -> ObservationRow:
    return residuals.observation_row(measured, row)


@njit
def step_residual(start: Float, motion: Float, motion_turn: Float, end: Float) -> tuple[float, float, float]:
    return residuals.step_residual(start, residuals.cosine_sine(start), motion, motion_turn, end)


@pytest.mark.parametrize("angle", [*ANGLES, *(-angle for angle in ANGLES)])
@pytest.mark.parametrize("length", [1e-3, 1.0, 1e6])
def test_angle_of_a_vector(angle: float, length: float) -> None:
    along, across = length * math.cos(angle), length * math.sin(angle)
    assert angle_of(along, across) == pytest.approx(math.atan2(across, along), rel=4e-16, abs=0)


@pytest.mark.parametrize("sensor", SENSORS)
def test_arrays_and_step_residuals_of_a_recording(sensor: str) -> None:
    recording = recording_of(sensor, 2)
    measured = measured_of(recording)
    for row in range(3):
        z, L = recording.observation[row], np.linalg.inv(measured.whitener[row])
        bearing = 0.0 if sensor == "position" else z[-1]
        np.testing.assert_allclose(L @ L.T, recording.observation_cov[row], rtol=1e-12, atol=1e-15)
        observation = observation_row(measured, row)
        assert observation[:4] == (z[0], z[-1], np.cos(bearing), np.sin(bearing))
        assert observation[4:] == tuple(measured.whitener[row][[0, -1, -1], [0, 0, -1]])
    poses = np.array([[1.0, -2.0, 3.0], [1.4, -1.9, -2.9]])
    expected = log(between(recording.odometry[0], between(poses[0], poses[1])))
    actual = step_residual(poses[0], measured.motion[1], measured.motion_turn[1], poses[1])
    np.testing.assert_allclose(actual, expected, rtol=0, atol=5e-15)


@pytest.mark.parametrize("heading", [0.4, -2.9])
@pytest.mark.parametrize("sensor", SENSORS)
def test_residual_of_an_observation_and_its_gradient(sensor: str, heading: float) -> None:
    """The measured bearing is far from the predicted one in the first case and near it in the second."""
    turn, root = (math.cos(heading), math.sin(heading)), np.array([[2.0, 0.0], [-0.7, 5.0]])
    for bearing in (2.5, 0.62 - heading):
        z = (1.5, -0.4) if sensor == "position" else (1.5, bearing) if sensor == "range-bearing" else (bearing, bearing)
        observation = ObservationRow(*z, math.cos(bearing), math.sin(bearing), root[0, 0], root[1, 0], root[1, 1])

        def seen(e: Float, z: tuple[float, float] = z) -> Float:
            c, s = turn
            if sensor == "position":
                return root @ [c * e[0] + s * e[1] - z[0], c * e[1] - s * e[0] - z[1]]
            off = math.remainder(math.atan2(e[1], e[0]) - heading - z[1], 2 * math.pi)
            return root @ [math.hypot(*e) - z[0], off] if sensor == "range-bearing" else np.array([root[0, 0] * off, 0])

        at = np.array([1.2, 0.85])
        r0, r1, a00, a01, a10, a11 = observation_residual(SENSORS[sensor].code, observation, turn, *at)
        np.testing.assert_allclose([r0, r1], seen(at), rtol=0, atol=5e-15)
        assert_jacobian(seen, np.array([[a00, a01], [a10, a11]]), at)
