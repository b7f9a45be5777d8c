"""Inverse depth: Jacobians, comparison with a dense reference, landmarks at infinity and at the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.ekf import textbook
from slamgauge.ekf.bearings.bearing_filter import BearingFilter
from slamgauge.ekf.bearings.inverse_depth import linearise_depths, linearity_index, locate_depth
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.ekf.settings import InverseDepth
from slamgauge.recording import Observations
from slamgauge.se2 import rotation, wrap
from tests.reference.jacobians import assert_jacobian
from tests.reference.textbook import J, exp_action

pytestmark = pytest.mark.slow

CORRECTIONS = pytest.mark.parametrize("correction", RULES)
POSE = np.array([0.7, -1.2, 0.4])
AWKWARD = [0.15, 0.0, -0.1, -3.0, 20.0, 1e-9]


def seen(name: int, bearing: float, variance: float) -> Observations:
    return Observations(np.array([name]), np.array([[bearing]]), np.array([[[variance]]]))


# --- Jacobians -----------------------------------------------------------------------------------


@pytest.mark.parametrize("omega", AWKWARD)
@pytest.mark.parametrize("phi", [0.3, math.pi, -math.pi, math.pi + 1e-9, 3.1, -1.6])
@pytest.mark.parametrize("heading", [0.4, math.pi])
def test_the_jacobian_of_bearings(omega: float, phi: float, heading: float) -> None:
    """Innovations are bearing minus prediction, hence the sign."""
    state = np.array([0.7, -1.2, heading, 0.2, -0.9, phi, omega, -1.0, 2.0, 0.1, 0.3])
    bearings = np.array([0.5, -2.0])
    _, jacobian = linearise_depths(state, bearings)
    assert_jacobian(lambda s: -linearise_depths(s, bearings)[0], jacobian, state, step=1e-4, angles=(0, 1))


@pytest.mark.parametrize("omega", [0.15, 3.0, 0.01])
@pytest.mark.parametrize("phi", [0.3, math.pi, -2.0])
def test_the_jacobian_of_the_position(omega: float, phi: float) -> None:
    state = np.array([0.2, -0.9, phi, omega])
    assert_jacobian(lambda s: locate_depth(s)[0], locate_depth(state)[1], state, step=[1e-3, 1e-3, 1e-3, omega * 1e-3])


@pytest.mark.parametrize("omega", [0.15, 3.0])
def test_the_predicted_bearing_is_that_of_the_position(omega: float) -> None:
    state = np.concatenate([POSE, [0.2, -0.9, 2.5, omega]])
    offset = locate_depth(state[3:])[0] - POSE[:2]
    bearing = np.arctan2(offset[1], offset[0]) - POSE[2]
    np.testing.assert_allclose(linearise_depths(state, np.array([bearing]))[0], 0.0, atol=1e-14)


def test_at_infinity_a_bearing_depends_on_the_direction_only() -> None:
    state = np.concatenate([POSE, [5.0, -0.9, 2.5, 0.0]])
    innovation, jacobian = linearise_depths(state, np.array([2.5 - POSE[2]]))
    np.testing.assert_allclose(innovation, 0.0, atol=1e-15)
    np.testing.assert_array_equal(jacobian[0, [0, 1, 3, 4]], 0.0)
    np.testing.assert_allclose(jacobian[0, [2, 5]], [-1.0, 1.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 0.009])
def test_a_landmark_at_the_robot_has_no_bearing(distance: float) -> None:
    """As in `slamgauge.sensors`: within a centimetre a bearing carries no information."""
    state = np.array([4.0 - distance, 0.0, 0.2, 0.0, 0.0, 0.0, 0.25])
    innovation, jacobian = linearise_depths(state, np.array([1.0]))
    np.testing.assert_array_equal(innovation, 0.0)
    np.testing.assert_array_equal(jacobian, 0.0)
    assert math.isfinite(linearity_index(state[3:], 0.01, state[:3]))
    state[0] = 4.0 - 0.011
    innovation, jacobian = linearise_depths(state, np.array([1.0]))
    np.testing.assert_allclose(innovation, 1.2, atol=1e-12)
    assert np.abs(jacobian).max() > 20.0


# --- comparison with a dense reference -----------------------------------------------------------


class Twin:
    """Robot and landmark on full matrices; the right-invariant filter in the coordinates of its error."""

    def __init__(self, mean: Float, cov: Float, settings: InverseDepth, *, invariant: bool) -> None:
        self.x, self.P, self.settings, self.invariant = mean.copy(), cov.copy(), settings, invariant

    def to_additive(self) -> Float:
        """Return D: positions of robot, anchor and point rotate with the map; direction and inverse depth do not."""
        D = np.eye(len(self.x))
        if self.invariant:
            for first in (0, 3)[: 1 + (len(self.x) > 3)]:
                D[first : first + 2, 2] = J @ self.x[first : first + 2]
        return D

    def begin(self, z: float, R: float) -> None:
        G = np.zeros((4, 3))
        G[:3] = np.eye(3)
        T = np.vstack([np.eye(3), G])
        self.P = T @ self.P @ T.T
        self.P[5, 5] += R
        self.P[6, 6] += self.settings.sigma**2
        self.x = np.concatenate([self.x, self.x[:2], [self.x[2] + z, self.settings.mean]])

    def predict(self, increment: Float, Q: Float) -> None:
        self.x, self.P, _ = textbook.predict(textbook.Belief(self.x, self.P, ()), increment, Q)

    def update(self, z: float, R: float) -> None:
        x, H = self.x, np.zeros(len(self.x))
        if len(x) == 7:
            delta = x[6] * (x[3:5] - x[:2]) + np.array([np.cos(x[5]), np.sin(x[5])])
            across = J @ delta / (delta @ delta)
            H[:2], H[3:5] = -x[6] * across, x[6] * across
            H[5] = across @ np.array([-np.sin(x[5]), np.cos(x[5])])
            H[6] = across @ (x[3:5] - x[:2])
        else:
            delta = x[3:] - x[:2]
            across = J @ delta / (delta @ delta)
            H[:2], H[3:] = -across, across
        H[2] = -1.0
        v = float(wrap(z - (np.arctan2(delta[1], delta[0]) - x[2])))
        S = H @ self.P @ H + R
        assert v * v < 9.0 * S
        back = np.linalg.inv(self.to_additive())
        K = self.P @ H / S
        P = back @ (self.P - S * np.outer(K, K)) @ back.T
        self.x = self.moved(back @ K * v)
        D = self.to_additive()
        self.P = D @ P @ D.T

    def moved(self, xi: Float) -> Float:
        x = self.x + xi
        if self.invariant:
            points = self.x if len(self.x) == 5 else self.x[:5]
            x[: len(points)] = exp_action(xi[: len(points)], points)
        x[2] = wrap(x[2])
        return x

    def settle(self) -> bool:
        """Convert the landmark into a point if its linearity index is small (Civera, equation 40)."""
        sigma, u = np.sqrt(self.P[6, 6]), np.array([np.cos(self.x[5]), np.sin(self.x[5])])
        landmark = self.x[3:5] + u / self.x[6]
        away = landmark - self.x[:2]
        d = np.hypot(*away)
        if 4.0 * sigma / self.x[6] ** 2 / d * abs(u @ away / d) >= self.settings.linearity:
            return False
        T = np.zeros((5, 7))
        T[:3, :3] = np.eye(3)
        T[3:, 3:5] = np.eye(2)
        T[3:, 5], T[3:, 6] = J @ u / self.x[6], -u / self.x[6] ** 2
        self.x, self.P = np.concatenate([self.x[:3], landmark]), T @ self.P @ T.T
        return True


@pytest.mark.parametrize("correction", ["standard", "right-invariant"])
@pytest.mark.parametrize("heading", [0.5, 3.1])
def test_a_landmark_equals_the_dense_reference(correction: Correction, heading: float) -> None:
    """State and covariance from the first bearing until the landmark has been a point for ten steps."""
    rng = np.random.default_rng(4)
    mean, cov = (
        np.array([0.3, -0.2, heading]),
        np.array([[0.01, 0.002, 0.0], [0.002, 0.02, 0.001], [0.0, 0.001, 0.001]]),
    )
    settings = InverseDepth(mean=0.2, sigma=0.1)
    slam = BearingFilter(mean, cov, correction, settings)
    twin = Twin(mean, cov, settings, invariant=correction == "right-invariant")
    truth, R = mean.copy(), np.deg2rad(2.0) ** 2
    landmark = truth[:2] + rotation(heading) @ np.array([4.0, 2.5])
    Q = np.diag([0.03, 0.0, 0.005]) ** 2
    steps_as_depth, settled_for = 0, 0
    for k in range(80):
        if k > 0:
            increment = np.array([0.15, 0.0, 0.01])
            truth[:2] += rotation(truth[2]) @ increment[:2]
            truth[2] += increment[2]
            slam.predict(increment, Q)
            twin.predict(increment, Q)
        offset = landmark - truth[:2]
        z = float(wrap(np.arctan2(offset[1], offset[0]) - truth[2] + np.sqrt(R) * rng.normal()))
        slam.update(seen(7, z, R))
        if k == 0:
            twin.begin(z, R)
        else:
            twin.update(z, R)
            if len(twin.x) == 7:
                steps_as_depth += 1
                settled_for += twin.settle()
            else:
                settled_for += 1
        assert slam.provisional == ({7: 1} if len(twin.x) == 7 else {})
        np.testing.assert_allclose(slam.pose, twin.x[:3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(slam.cov, twin.P, rtol=0, atol=1e-11)
        place = locate_depth(twin.x[3:])[0] if len(twin.x) == 7 else twin.x[3:]
        np.testing.assert_allclose(slam.landmarks[0], place, rtol=0, atol=1e-9)
        if len(twin.x) == 7:
            jacobian = locate_depth(twin.x[3:])[1]
            expected = jacobian @ twin.P[3:, 3:] @ jacobian.T
            np.testing.assert_allclose(slam.landmark_covs[0], expected, rtol=1e-8, atol=1e-10)
        if settled_for == 10:
            break
    assert steps_as_depth > 10
    assert settled_for == 10
    log = slam.ray_log(np.zeros(1, np.int64))
    assert log is not None
    assert (log.landmark.tolist(), log.birth.tolist(), log.end.tolist()) == ([7], [0], [steps_as_depth])
    assert log.survivor.tolist() == [0]
    np.testing.assert_allclose(log.distances, [[5.0]])


# --- at infinity ---------------------------------------------------------------------------------


def omega_of(slam: BearingFilter, cov_entry: int = 6) -> tuple[float, float]:
    """Return the inverse depth of the only landmark, and its standard deviation."""
    inner = slam._map
    return float(inner.state.entries(np.array([cov_entry]))[0]), math.sqrt(slam.cov[cov_entry, cov_entry])


def assert_sound(slam: BearingFilter) -> None:
    P = slam.cov
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P)[0] > -1e-12 * np.trace(P)
    assert np.isfinite(slam.pose).all()
    assert np.isfinite(slam.landmarks).all()
    assert np.isfinite(slam.landmark_covs).all()


@CORRECTIONS
def test_a_negative_inverse_depth_recovers(correction: Correction) -> None:
    """Three bearings with an error of 3 degrees make it negative; later bearings make it a point at 20 m."""
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), correction, InverseDepth(mean=0.05, sigma=0.05))
    landmark, R, below = np.array([2.0, 20.0]), np.deg2rad(1.0) ** 2, 0
    pose = np.zeros(3)
    for k in range(120):
        if k:
            pose[0] += 0.2
            slam.predict([0.2, 0.0, 0.0], np.diag([1e-4, 1e-4, 1e-6]) ** 2)
        offset = landmark - pose[:2]
        unlucky = -0.05 if 2 <= k < 5 else 0.0
        slam.update(seen(3, float(np.arctan2(offset[1], offset[0])) + unlucky, R))
        assert_sound(slam)
        below += bool(slam.provisional) and omega_of(slam)[0] < 0.0
        assert np.hypot(*slam.landmarks[0]) < 10.0 / 0.05 + 30.0  # FARTHEST; the anchor is near the origin
    assert below >= 2
    assert not slam.provisional
    log = slam.ray_log(np.zeros(1, np.int64))
    assert log is not None
    assert log.survivor.tolist() == [0]  # one ray, never deleted
    np.testing.assert_allclose(slam.landmarks[0], landmark, atol=1.0)


@CORRECTIONS
def test_a_landmark_beyond_infinity_is_deleted_and_started_again(correction: Correction) -> None:
    """The bearings diverge as the robot moves: no point in front of it explains them."""
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), correction, InverseDepth(mean=0.15, sigma=0.2, gate=1e9))
    pose, beyond, ends = np.zeros(3), 0, 0
    for k in range(60):
        if k:
            pose[0] += 0.1
            slam.predict([0.1, 0.0, 0.0], np.diag([1e-3, 1e-3, 1e-4]) ** 2)
        slam.update(seen(3, math.pi / 2 - 0.1 * pose[0], np.deg2rad(1.0) ** 2))
        assert_sound(slam)
        omega, sigma = omega_of(slam)
        assert omega >= -3.0 * sigma
        beyond += omega < 0.0
        log = slam.ray_log(np.zeros(1, np.int64))
        assert log is not None
        if (log.end >= 0).sum() > ends:
            ends = int((log.end >= 0).sum())
            assert log.end[ends - 1] == log.birth[ends] == k
            assert omega == 0.15  # started again by this bearing
        assert log.survivor.tolist() == [-1] * len(log.landmark)
        assert slam.provisional == {3: 1}
    assert beyond > 3
    assert ends >= 2


@CORRECTIONS
@pytest.mark.parametrize("lost_after", [1, 3])
def test_a_landmark_that_fails_the_gate_is_deleted(correction: Correction, lost_after: int) -> None:
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), correction, InverseDepth(lost_after=lost_after))
    slam.update(seen(1, 0.0, 1e-4))
    slam.update(seen(1, 0.01, 1e-4))
    before = slam.landmarks, slam.cov
    for _ in range(lost_after - 1):
        slam.update(seen(1, 1.0, 1e-4))
        np.testing.assert_array_equal(slam.landmarks, before[0])
        np.testing.assert_array_equal(slam.cov, before[1])
    slam.update(seen(1, 1.0, 1e-4))
    np.testing.assert_allclose(np.arctan2(*slam.landmarks[0][::-1]), 1.0, atol=1e-12)
    log = slam.ray_log(np.zeros(1, np.int64))
    assert log is not None
    assert (log.end.tolist(), log.survivor.tolist()) == ([0, -1], [-1, -1])


def test_only_failures_in_a_row_count() -> None:
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), initialisation=InverseDepth(lost_after=2))
    for bearing in (0.0, 1.0, 0.0, 1.0, 0.0):
        slam.update(seen(1, bearing, 1e-4))
    np.testing.assert_allclose(slam.landmarks[0], [1 / 0.15, 0.0], atol=1e-9)


@pytest.mark.parametrize("correction", ["standard", "right-invariant"])
@pytest.mark.parametrize(("x", "y", "seed"), [(9.0, 0.1, 2), (9.0, 0.2, 40), (10.0, 0.1, 10), (10.0, 0.05, 53)])
def test_passing_the_estimate_of_an_uncertain_landmark_gives_no_information(
    correction: Correction, x: float, y: float, seed: int
) -> None:
    """The robot drives towards the landmark, so that its depth stays unknown, and passes the wrong estimate.

    A bearing of a point at a few centimetres is very nonlinear. Updates with such bearings made the depth overconfident
    in these runs: 3-dof NEES of 190 to 7400.
    """
    rng = np.random.default_rng(seed)
    slam, pose = BearingFilter(np.zeros(3), np.zeros((3, 3)), correction, InverseDepth()), np.zeros(3)
    for k in range(150):
        if k:
            pose[0] += 0.1
            increment = [0.1 + 0.002 * rng.normal(), 0.0005 * rng.normal(), 0.001 * rng.normal()]
            slam.predict(increment, np.diag([0.002, 0.0005, 0.001]) ** 2)
        bearing = np.arctan2(y - pose[1], x - pose[0]) - pose[2] + 0.05 * rng.normal()
        slam.update(seen(0, float(bearing), 0.05**2))
        assert_sound(slam)
        if k:
            error = slam.pose - pose
            assert error @ np.linalg.solve(slam.pose_cov, error) < chi2(3).isf(1e-4)
