"""Every Jacobian of the filters against central differences, at the places where they tend to break.

The references are written here: sensor models, motion, and the position of a landmark that is observed. Tolerances are
the accuracy of the differences, not of the kernels. `tests/core/test_sensors.py` has the sensor models themselves.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.se2 import compose, rotation
from slamgauge.sensors import MIN_BEARING_DISTANCE
from slamgauge.sensors import SENSORS as TABLE
from tests.reference.jacobians import assert_jacobian, differentiate
from tests.reference.textbook import belief_of, unobservable

PI = math.pi
RANGE_BEARING, POSITION = TABLE["range-bearing"].code, TABLE["position"].code
# the differences step 2 * 1e-3 of the distance towards the sensor: they must not cross the guard
CLOSE = 1.01 * MIN_BEARING_DISTANCE
HEADINGS = [0.0, 0.7, PI / 2, PI, PI - 1e-12, -PI + 1e-12, -2.5]
BEARINGS = [0.0, 1.1, PI / 2, PI, -PI + 1e-12, -2.0]
DISTANCES = [CLOSE, 0.3, 8.0, 200.0]
SENSORS = [pytest.param(RANGE_BEARING, id="range-bearing"), pytest.param(POSITION, id="position")]


def direction(angle: float) -> Float:
    return np.array([math.cos(angle), math.sin(angle)])


def seen(sensor: int, delta: Float) -> Float:
    """Return the observation of a landmark at `delta` in the body frame."""
    return delta if sensor == POSITION else np.array([np.hypot(*delta), np.arctan2(delta[1], delta[0])])


def placed(sensor: int, pose: Float, z: Float) -> Float:
    """Return the world position of a landmark observed as `z` from `pose`."""
    delta = z if sensor == POSITION else z[0] * direction(z[1])
    return pose[:2] + rotation(pose[2]) @ delta


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


# --- the innovation's Jacobian -------------------------------------------------------------------


def linearised(
    sensor: int, state: Float, slots: list[int], z: Float, point: Float | None = None, *, observable: bool = False
) -> tuple[Float, Float, int]:
    """Return innovations (2m,), the dense Jacobian (2m, size) and the number of rows with information."""
    count = len(slots)
    innovation, compact = np.empty(2 * count), np.empty((2 * count, 5))
    belief = belief_of(state, np.eye(len(state)), point, observable=observable)
    informative = linearise(sensor, belief, np.array(slots), z, innovation, compact)
    dense = np.zeros((2 * count, len(state)))
    for row in range(2 * count):
        columns = [0, 1, 2, 3 + 2 * slots[row // 2], 4 + 2 * slots[row // 2]]
        dense[row, columns] += compact[row]
    return innovation, dense, informative


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("bearing", BEARINGS)
@pytest.mark.parametrize("heading", HEADINGS)
def test_linearise(sensor: int, heading: float, bearing: float, distance: float) -> None:
    """Three landmarks; the tested one is in the middle slot, the first is observed twice."""
    pose = np.array([3.0, -4.0, heading])
    awkward = pose[:2] + rotation(heading) @ (distance * direction(bearing))
    state = np.concatenate([pose, [5.0, 1.0], awkward, [-6.0, -9.0]])
    slots = [1, 0, 2, 0]
    offsets = state[3:].reshape(-1, 2)[slots] - pose[:2]
    z = np.array([seen(sensor, rotation(heading).T @ offset) for offset in offsets])
    innovation, H, informative = linearised(sensor, state, slots, z)
    assert informative == 8
    np.testing.assert_allclose(innovation, 0.0, atol=1e-12)
    assert_jacobian(
        lambda at: -linearised(sensor, at, slots, z)[0],
        H,
        state,
        step=[1e-3 * min(distance, 1.0)] * 2 + [1e-3] + [1e-3] * 2 + [1e-3 * distance] * 2 + [1e-3] * 2,
        tolerance=2e-9,  # rounding of l - p for a landmark at 1 cm: 1e-15 / (1e-5 * 100)
    )


@pytest.mark.parametrize("bearing", BEARINGS)
def test_linearise_ignores_the_bearing_of_a_landmark_at_the_robot(bearing: float) -> None:
    state = np.concatenate([[0.0, 0.0, 0.6], 0.5 * MIN_BEARING_DISTANCE * direction(bearing + 0.6)])
    innovation, H, informative = linearised(RANGE_BEARING, state, [0], np.array([[0.3, 1.0]]))
    assert informative == 1
    np.testing.assert_allclose(innovation, [0.3 - 0.5 * MIN_BEARING_DISTANCE, 0.0], atol=1e-15)
    np.testing.assert_array_equal(H[1], 0.0)
    np.testing.assert_allclose(H[0, 3:], direction(bearing + 0.6), atol=1e-13)


def test_an_innovation_across_pi_is_wrapped() -> None:
    state = np.array([0.0, 0.0, PI - 0.1, -2.0, 0.0])
    behind = np.array([0.0, 0.0, 0.1, -2.0, 0.0])
    for at, z in ((state, 0.1 + 2 * PI - 0.02), (behind, PI), (behind, -PI + 1e-3)):
        innovation, _, _ = linearised(RANGE_BEARING, at, [0], np.array([[2.0, z]]))
        assert abs(innovation[1]) < 0.11


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_innovation_is_taken_at_the_state_and_the_jacobian_at_the_point(sensor: int) -> None:
    state, point = np.array([3.0, -4.0, 0.4, 5.0, 1.0]), np.array([2.5, -4.2, 0.7, 4.6, 1.3])
    z = np.array([[5.0, 0.3]])
    innovation, H, _ = linearised(sensor, state, [0], z, point)
    np.testing.assert_array_equal(innovation, linearised(sensor, state, [0], z)[0])
    np.testing.assert_array_equal(H, linearised(sensor, point, [0], z)[1])


@pytest.mark.parametrize("sensor", SENSORS)
def test_projected_jacobians_are_the_nearest_without_translation_and_rotation(sensor: int) -> None:
    """H N = 0 to rounding, also far from the origin; the difference of the Jacobians is in the span of N."""
    rng = np.random.default_rng(2)
    changed = 0.0
    for _ in range(100):
        state = rng.uniform(-9, 9, 9) + rng.choice([0.0, 1000.0])
        point, slots = state + 0.3 * rng.normal(size=9), [1, 0, 2, 0]
        z = rng.uniform(1, 3, (4, 2))
        innovation, H, informative = linearised(sensor, state, slots, z, point, observable=True)
        before, free, count = linearised(sensor, state, slots, z)
        np.testing.assert_array_equal(innovation, before)
        assert informative == count
        N = unobservable(point)
        np.testing.assert_allclose(H @ N, 0.0, atol=1e-10 if state[0] > 100 else 1e-13)
        for row in range(8):
            columns = [0, 1, 2, 3 + 2 * slots[row // 2], 4 + 2 * slots[row // 2]]
            taken = (free - H)[row, columns]
            within = N[columns] @ np.linalg.lstsq(N[columns], taken, rcond=None)[0]
            np.testing.assert_allclose(taken, within, rtol=0, atol=1e-9)
        changed = max(changed, float(np.abs(free - H).max()))
    assert changed > 0.01


# --- prediction ----------------------------------------------------------------------------------

INCREMENTS = [[0.3, 0.0, 0.02], [0.0, 0.0, 0.0], [0.0, 0.0, PI], [-0.2, 0.7, -2.0], [40.0, 0.0, 1e-9]]


def predicted(
    pose: Float, cov: Float, increment: list[float], noise: Float, point: Float | None = None
) -> tuple[Float, Float]:
    """Return the state and the upper triangle of its covariance after `predict`."""
    size = len(cov)
    state, cov = np.concatenate([pose, np.zeros(size - 3)]), cov.copy()
    assert predict(belief_of(state, cov, point), np.array(increment), noise)
    return state, np.triu(cov)


@pytest.mark.parametrize("increment", INCREMENTS)
@pytest.mark.parametrize("heading", HEADINGS)
def test_prediction_multiplies_cross_covariances_by_the_jacobian(heading: float, increment: list[float]) -> None:
    """A unit cross-covariance with the map becomes F."""
    pose = np.array([3.0, -4.0, heading])
    cov = np.zeros((7, 7))
    cov[:3, 3:6] = np.eye(3)
    state, after = predicted(pose, cov, increment, np.zeros((3, 3)))
    np.testing.assert_allclose(state[:3], compose(pose, increment), rtol=1e-15, atol=1e-15)
    assert_jacobian(lambda at: compose(at, increment), after[:3, 3:6], pose, angles=[2])
    assert not after[:3, 6].any()
    assert not after[3:].any()


@pytest.mark.parametrize("increment", INCREMENTS)
@pytest.mark.parametrize("heading", HEADINGS)
def test_prediction_adds_noise_and_moves_the_robots_covariance_by_both_jacobians(
    heading: float, increment: list[float]
) -> None:
    rng = np.random.default_rng(0)
    pose = np.array([3.0, -4.0, heading])
    F = differentiate(lambda at: compose(at, increment), pose, angles=[2])
    G = differentiate(lambda at: compose(pose, at), increment, angles=[2])
    for _ in range(6):  # six random symmetric matrices span all
        root_P, root_Q = rng.normal(size=(2, 3, 3))
        P, Q = root_P @ root_P.T, root_Q @ root_Q.T
        after = predicted(pose, P, increment, Q)[1]
        expected = F @ P @ F.T + G @ Q @ G.T
        np.testing.assert_allclose(after, np.triu(expected), rtol=0, atol=1e-10 * np.abs(expected).max())


def test_the_jacobian_of_a_prediction_from_a_first_estimate() -> None:
    pose, point, increment = np.array([3.0, -4.0, 0.6]), np.array([2.8, -4.1, 0.5, 0.0]), [0.3, 0.1, 0.02]
    cov = np.zeros((6, 6))
    cov[:3, 3:] = np.eye(3)
    before = point.copy()
    state, after = predicted(pose, cov, increment, np.zeros((3, 3)), point)
    lever = state[:2] - before[:2]
    np.testing.assert_allclose(after[:3, 3:], [[1, 0, -lever[1]], [0, 1, lever[0]], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(point, [*state[:3], 0.0])


# --- augmentation --------------------------------------------------------------------------------


def augmented(sensor: int, pose: Float, cov: Float, z: Float, R: Float) -> tuple[Float, Float]:
    """Return the new landmark and its columns of the upper triangle."""
    size = len(cov)
    state, room = np.concatenate([pose, np.zeros(size - 1)]), np.zeros((size + 2, size + 2))
    room[:size, :size] = cov
    augment(sensor, belief_of(state, room)._replace(size=size), z[None], R[None])
    np.testing.assert_array_equal(room[:size, :size], cov)
    return state[size:], room[:, size:]


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("distance", [0.0, *DISTANCES])
@pytest.mark.parametrize("bearing", BEARINGS)
@pytest.mark.parametrize("heading", HEADINGS)
def test_augmentation(sensor: int, heading: float, bearing: float, distance: float) -> None:
    """A unit cross-covariance with the map becomes J_r; sensor noise becomes J_z R J_z'."""
    pose = np.array([3.0, -4.0, heading])
    z = distance * direction(bearing) if sensor == POSITION else np.array([distance, bearing])
    cov = np.zeros((7, 7))
    cov[:3, 3:6] = np.eye(3)
    landmark, columns = augmented(sensor, pose, cov, z, np.zeros((2, 2)))
    np.testing.assert_allclose(landmark, placed(sensor, pose, z), rtol=1e-14, atol=1e-14)
    assert_jacobian(lambda at: placed(sensor, at, z), columns[3:6].T, pose)
    np.testing.assert_array_equal(columns[[0, 1, 2, 6]], 0.0)

    R = np.array([[0.04, 0.01], [0.01, 0.09]])
    J_z = differentiate(lambda at: placed(sensor, pose, at), z)
    own = augmented(sensor, pose, np.zeros((3, 3)), z, R)[1][3:]
    expected = np.triu(J_z @ R @ J_z.T)
    np.testing.assert_allclose(np.triu(own), expected, rtol=0, atol=1e-10 * np.abs(expected).max())
