"""Jacobians of the filters at the places where they tend to break: the textbook's against central differences, those of
the kernels against the textbook's.

Tolerances are the accuracy of the differences. `tests/core/test_sensors.py` has the sensor models themselves.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import textbook
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.se2 import compose, rotation
from slamgauge.sensors import MIN_BEARING_DISTANCE
from slamgauge.sensors import SENSORS as TABLE
from slamgauge.sensors import predict as observed
from tests.reference.jacobians import assert_jacobian
from tests.reference.textbook import J, belief_of, unobservable

PI = math.pi
# the differences step 2 * 1e-3 of the distance towards the sensor: they must not cross the guard
CLOSE = 1.01 * MIN_BEARING_DISTANCE
BEARINGS = [0.0, 1.1, PI / 2, PI, -PI + 1e-12, -2.0]
DISTANCES = [CLOSE, 0.3, 8.0, 200.0]
INCREMENTS = [[0.3, 0.0, 0.02], [0.0, 0.0, 0.0], [0.0, 0.0, PI], [-0.2, 0.7, -2.0], [40.0, 0.0, 1e-9]]
HEADINGS = pytest.mark.parametrize("heading", [0.0, 0.7, PI / 2, PI, PI - 1e-12, -PI + 1e-12, -2.5])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
SLOTS = [1, 0, 2, 0]  # the landmark at an awkward place is in the middle slot, the first is observed twice


def direction(angle: float) -> Float:
    return np.array([math.cos(angle), math.sin(angle)])


def random_cov(size: int) -> Float:
    root = np.random.default_rng(size).normal(size=(size, size))
    return root @ root.T


# --- the check itself ----------------------------------------------------------------------------


def test_differences_detect_a_slightly_wrong_jacobian() -> None:
    def function(x: Float) -> Float:
        return np.array([np.sin(x[0]) * x[1], np.arctan2(x[1], x[0])])

    at = np.array([0.4, -1.3])
    exact = np.array([[np.cos(0.4) * -1.3, np.sin(0.4)], [1.3 / (0.16 + 1.69), 0.4 / (0.16 + 1.69)]])
    assert_jacobian(function, exact, at)
    for wrong in (exact + 1e-8 * np.eye(2), exact.T, -exact, exact[:1]):
        with pytest.raises(AssertionError):
            assert_jacobian(function, wrong, at)


def test_differences_across_the_cut_of_an_angle() -> None:
    def function(x: Float) -> Float:
        return np.array([np.arctan2(x[0], -1.0)])

    assert_jacobian(function, [[-1.0]], [0.0], angles=[0])
    with pytest.raises(AssertionError):
        assert_jacobian(function, [[-1.0]], [0.0])


# --- observations --------------------------------------------------------------------------------


def by_textbook(sensor: str, x: Float, z: Float, point: Float | None = None) -> tuple[Float, Float]:
    """Return innovations (8,) and the dense Jacobian (8, size) of observations (4, 2) of the landmarks in `SLOTS`."""
    seen = textbook.linearise(sensor, x, np.array(SLOTS), z, np.zeros((4, 2, 2)), point)
    return textbook.stack(seen, len(x))[:2]


def by_kernel(
    sensor: str, x: Float, z: Float, point: Float | None = None, *, observable: bool = False
) -> tuple[Float, Float, int]:
    """Return innovations, the dense Jacobian and the number of rows with information."""
    innovation, compact = np.empty(8), np.empty((8, 5))
    belief = belief_of(x, np.eye(len(x)), point, observable=observable)
    informative = linearise(TABLE[sensor].code, belief, np.array(SLOTS), z, innovation, compact)
    dense = np.zeros((8, len(x)))
    for row in range(8):
        dense[row, [0, 1, 2, 3 + 2 * SLOTS[row // 2], 4 + 2 * SLOTS[row // 2]]] += compact[row]
    return innovation, dense, informative


@SENSORS
@HEADINGS
@pytest.mark.parametrize("distance", [0.0, 0.5 * MIN_BEARING_DISTANCE, *DISTANCES])
def test_the_jacobian_of_observations(sensor: str, heading: float, distance: float) -> None:
    """The innovation is taken at the state, and the Jacobian at the point."""
    pose, angles = np.array([3.0, -4.0, heading]), [1, 3, 5, 7] if sensor == "range-bearing" else []
    for bearing in BEARINGS:
        awkward = pose[:2] + rotation(heading) @ (distance * direction(bearing))
        state = np.concatenate([pose, [5.0, 1.0], awkward, [-6.0, -9.0]])
        offsets = (state[3:].reshape(-1, 2)[SLOTS] - pose[:2]) @ rotation(heading)
        z = np.add(observed(sensor, offsets), [0.1, 0.02])
        v, H = by_textbook(sensor, state, z)
        step = [1e-3 * min(distance, 1.0)] * 2 + [1e-3] + [1e-3] * 2 + [1e-3 * distance] * 2 + [1e-3] * 2
        if distance >= CLOSE:  # tolerance: rounding of l - p for a landmark at 1 cm, 1e-15 / (1e-5 * 100)
            functions = (lambda at, z=z: -by_textbook(sensor, at, z)[0]), H, state
            assert_jacobian(*functions, step=step, tolerance=2e-9, angles=angles)
        found, dense, informative = by_kernel(sensor, state, z)
        np.testing.assert_allclose(found, v, rtol=0, atol=1e-12)
        np.testing.assert_allclose(dense, H, rtol=1e-12, atol=1e-12)
        assert informative == H.any(axis=1).sum()
        if distance == 0.0:  # a bearing has no direction there
            continue
        point = state + 0.1 * np.sin(np.arange(9.0))
        for actual, expected in zip(
            by_kernel(sensor, state, z, point)[:2], by_textbook(sensor, state, z, point), strict=True
        ):
            np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-12)


@SENSORS
def test_projected_jacobians_are_the_nearest_without_translation_and_rotation(sensor: str) -> None:
    """H N = 0 to rounding, also far from the origin; the difference of the Jacobians is in the span of N."""
    rng = np.random.default_rng(2)
    changed = 0.0
    for _ in range(100):
        state = rng.uniform(-9, 9, 9) + rng.choice([0.0, 1000.0])
        point, z = state + 0.3 * rng.normal(size=9), rng.uniform(1, 3, (4, 2))
        innovation, H, informative = by_kernel(sensor, state, z, point, observable=True)
        before, free, count = by_kernel(sensor, state, z)
        np.testing.assert_array_equal(innovation, before)
        assert informative == count
        N = unobservable(point)
        np.testing.assert_allclose(H @ N, 0.0, atol=1e-10 if state[0] > 100 else 1e-13)
        for row in range(8):
            columns = [0, 1, 2, 3 + 2 * SLOTS[row // 2], 4 + 2 * SLOTS[row // 2]]
            taken = (free - H)[row, columns]
            within = N[columns] @ np.linalg.lstsq(N[columns], taken, rcond=None)[0]
            np.testing.assert_allclose(taken, within, rtol=0, atol=1e-9)
        changed = max(changed, float(np.abs(free - H).max()))
    assert changed > 0.01


# --- prediction ----------------------------------------------------------------------------------


@HEADINGS
@pytest.mark.parametrize("increment", INCREMENTS)
def test_the_jacobians_of_a_prediction(heading: float, increment: list[float]) -> None:
    """F is multiplied with the lever from the robot's position in `point` if there is one; the pose is copied to it."""
    x, u, P, Q = np.array([3.0, -4.0, heading, 1.0, 2.0]), np.array(increment), random_cov(5), random_cov(3)
    F, G = textbook.motion_jacobians(x, u)
    assert_jacobian(lambda at: compose(at, u), F, x[:3], angles=[2])
    assert_jacobian(lambda at: compose(x[:3], at), G, u, angles=[2])
    expected = textbook.predict(textbook.Belief(x, P, ()), u, Q)
    state, cov = x.copy(), P.copy()
    assert predict(belief_of(state, cov), u, Q)
    np.testing.assert_allclose(state, expected.x, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(np.triu(cov), np.triu(expected.P), rtol=1e-12, atol=1e-12)

    point = x + 0.1
    F[:2, 2] += J @ (x[:2] - point[:2])
    whole = np.eye(5)
    whole[:3, :3] = F
    moved = whole @ P @ whole.T
    moved[:3, :3] += G @ Q @ G.T
    state, cov = x.copy(), P.copy()
    assert predict(belief_of(state, cov, point), u, Q)
    np.testing.assert_allclose(np.triu(cov), np.triu(moved), rtol=1e-12, atol=1e-11)
    np.testing.assert_array_equal(point[:3], state[:3])


# --- augmentation --------------------------------------------------------------------------------


@SENSORS
@HEADINGS
@pytest.mark.parametrize("distance", [0.0, *DISTANCES])
def test_the_jacobians_of_a_new_landmark(sensor: str, heading: float, distance: float) -> None:
    x, P, R = np.array([3.0, -4.0, heading, 1.0, 2.0]), random_cov(5), np.array([[0.04, 0.01], [0.01, 0.09]])
    for bearing in BEARINGS:
        z = distance * direction(bearing) if sensor == "position" else np.array([distance, bearing])
        _, J_r, J_z = textbook.locate(sensor, x[:3], z)
        assert_jacobian(lambda at, z=z: textbook.locate(sensor, at, z)[0], J_r, x[:3])
        assert_jacobian(lambda at: textbook.locate(sensor, x[:3], at)[0], J_z, z)
        expected = textbook.augment(sensor, textbook.Belief(x, P, ()), 1, z, R)
        state, cov = np.append(x, [0.0, 0.0]), np.zeros((7, 7))
        cov[:5, :5] = P
        augment(TABLE[sensor].code, belief_of(state, cov)._replace(size=5), z[None], R[None])
        np.testing.assert_allclose(state, expected.x, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(np.triu(cov), np.triu(expected.P), rtol=1e-11, atol=1e-11)
