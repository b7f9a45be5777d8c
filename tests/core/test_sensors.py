"""Sensor models: Jacobians compared with central differences, inverses, wrapped angles, kernels compared with numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.formula_kernels import locate, observe, wrap_innovation
from slamgauge.sensors import (
    MIN_BEARING_DISTANCE,
    SENSORS,
    innovation,
    inverse,
    inverse_jacobian,
    jacobian,
    predict,
)
from tests.reference.jacobians import assert_jacobian

PI = math.pi
JUST_FAR_ENOUGH = 1.0001 * MIN_BEARING_DISTANCE
# the differences step 2 * 1e-3 of the distance towards the sensor: they must not cross the guard
CLOSE = 1.01 * MIN_BEARING_DISTANCE
BEARINGS = [0.0, 1.1, PI / 2, PI, -PI + 1e-12, -2.0]
DISTANCES = [CLOSE, 0.3, 8.0, 200.0]
PLACING = [name for name, model in SENSORS.items() if model.places_landmarks]


def direction(angle: float) -> Float:
    return np.array([math.cos(angle), math.sin(angle)])


def angle_rows(sensor: str) -> list[int]:
    return [int(row) for row in np.flatnonzero(SENSORS[sensor].is_angle)]


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("bearing", BEARINGS)
def test_the_jacobian_of_a_prediction(sensor: str, distance: float, bearing: float) -> None:
    delta = distance * direction(bearing)
    assert_jacobian(
        lambda at: predict(sensor, at), jacobian(sensor, delta), delta, step=1e-3 * distance, angles=angle_rows(sensor)
    )


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("distance", [0.0, *DISTANCES])
@pytest.mark.parametrize("bearing", BEARINGS)
def test_the_jacobian_of_an_inverse(sensor: str, distance: float, bearing: float) -> None:
    z = predict(sensor, distance * direction(bearing))
    assert_jacobian(lambda at: inverse(sensor, at), inverse_jacobian(sensor, z), z)


@pytest.mark.parametrize("bearing", BEARINGS)
def test_what_the_sensors_measure(bearing: float) -> None:
    delta = 3.0 * np.tile(direction(bearing), (3, 4, 1))  # any shape
    np.testing.assert_allclose(predict("position", delta), delta, rtol=0, atol=0)
    np.testing.assert_allclose(
        predict("range-bearing", delta), np.tile([3.0, bearing], (3, 4, 1)), rtol=1e-15, atol=1e-15
    )
    np.testing.assert_allclose(predict("bearing", delta), np.full((3, 4, 1), bearing), rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(inverse("bearing", [bearing]), direction(bearing), rtol=1e-15, atol=1e-16)  # at 1 m


@pytest.mark.parametrize("sensor", PLACING)
@pytest.mark.parametrize("bearing", BEARINGS)
def test_an_inverse_undoes_a_prediction(sensor: str, bearing: float) -> None:
    delta = JUST_FAR_ENOUGH * direction(bearing)
    z = predict(sensor, delta)
    np.testing.assert_allclose(inverse(sensor, z), delta, rtol=0, atol=1e-17)
    np.testing.assert_allclose(jacobian(sensor, delta) @ inverse_jacobian(sensor, z), np.eye(2), atol=1e-13)


@pytest.mark.parametrize("bearing", BEARINGS)
def test_within_a_centimetre_a_bearing_carries_no_information_but_the_range_does(bearing: float) -> None:
    delta = 0.5 * MIN_BEARING_DISTANCE * direction(bearing)
    assert predict("range-bearing", delta)[0] == pytest.approx(0.5 * MIN_BEARING_DISTANCE, rel=1e-14)
    A = jacobian("range-bearing", delta)
    np.testing.assert_allclose(A, np.vstack([direction(bearing), np.zeros(2)]), rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(jacobian("bearing", delta), np.zeros((1, 2)))
    np.testing.assert_array_equal(jacobian("range-bearing", [0.0, 0.0]), np.zeros((2, 2)))
    assert jacobian("bearing", delta, nearest=0.0).any()


def test_an_innovation_across_pi_is_wrapped() -> None:
    z, predicted = np.array([[2.0, PI - 0.01], [1.0, -PI + 0.02]]), np.array([[1.5, -PI + 0.02], [1.0, PI - 0.01]])
    np.testing.assert_allclose(innovation("range-bearing", z, predicted), [[0.5, -0.03], [0.0, 0.03]], atol=1e-14)
    np.testing.assert_allclose(innovation("bearing", z[:, 1:], predicted[:, 1:]), [[-0.03], [0.03]], atol=1e-14)
    np.testing.assert_array_equal(innovation("position", [[4.0, 4.0]], [[0.0, 0.0]]), [[4.0, 4.0]])


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("distance", [0.0, 0.5 * MIN_BEARING_DISTANCE, *DISTANCES])
@pytest.mark.parametrize("bearing", BEARINGS)
def test_kernels_predict_as_numpy_does(sensor: str, distance: float, bearing: float) -> None:
    """In kernels a single number is the second row; the first row is zero."""
    delta, dim = distance * direction(bearing), SENSORS[sensor].dim
    z0, z1, *A = observe(SENSORS[sensor].code, *delta)
    z, rows = np.zeros(2), np.zeros((2, 2))
    z[-dim:], rows[-dim:] = predict(sensor, delta), jacobian(sensor, delta)
    np.testing.assert_allclose([z0, z1], z, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(np.reshape(A, (2, 2)), rows, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("bearing", BEARINGS)
def test_kernels_locate_and_wrap_as_numpy_does(sensor: str, bearing: float) -> None:
    """With a bearing, kernels assume the range in the first row."""
    z, code = predict(sensor, direction(bearing)), SENSORS[sensor].code
    found = locate(code, *np.concatenate([np.ones(2 - len(z)), z]))
    np.testing.assert_allclose(found[:2], inverse(sensor, z), rtol=1e-15, atol=1e-15)
    B = np.reshape(found[2:], (2, 2))
    np.testing.assert_allclose(B[:, -len(z) :], inverse_jacobian(sensor, z), rtol=1e-15, atol=1e-15)
    wrapped = [wrap_innovation(code, row, 4.0) for row in range(2)][-len(z) :]
    np.testing.assert_allclose(wrapped, innovation(sensor, np.full(len(z), 4.0), np.zeros(len(z))), rtol=1e-15)
