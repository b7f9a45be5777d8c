"""Parts of the filters in numpy: Jacobians, sigma points and their moments, the Kalman update."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import riekf, riukf
from slamgauge.ekf.advanced.dense_algebra import block_diagonal, kalman_step, place_jacobian, times_rows
from slamgauge.ekf.advanced.robocentric import RobocentricBelief, pose_jacobian
from slamgauge.ekf.advanced.sigma_points import (
    SPREAD,
    InvariantBelief,
    about_zero,
    moments,
    motion_noise,
    symmetric_roots,
)
from slamgauge.se2 import between, mean_rotation, rotation
from tests.reference.circles import Estimator
from tests.reference.jacobians import assert_jacobian
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

ANGLES = [0.0, 1e-9, 0.7, -2.0, math.pi - 1e-9, -math.pi + 1e-9]
J = np.array([[0.0, -1.0], [1.0, 0.0]])


# --- Jacobians -----------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", ANGLES)
def test_positions_in_the_body_frame(heading: float) -> None:
    robot, place = np.array([2.0, -1.0, heading]), np.array([2.001, -1.0])

    def seen(at: Float) -> Float:
        return rotation(at[2]).T @ (at[3:] - at[:2])

    at = np.concatenate([robot, place])
    jacobian = place_jacobian(heading, np.stack([seen(at), seen(at)]))
    assert_jacobian(seen, jacobian[0], at)
    rng = np.random.default_rng(0)
    rows, places = rng.normal(size=(3, 4)), rng.normal(size=(4, 4))
    expected = np.vstack([jacobian[k] @ np.vstack([rows, places[2 * k : 2 * k + 2]]) for k in range(2)])
    np.testing.assert_allclose(times_rows(jacobian, rows, places), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("heading", ANGLES)
@pytest.mark.parametrize("turn", ANGLES)
def test_the_pose_from_the_world_frame_in_the_body_frame(heading: float, turn: float) -> None:
    both = np.array([0.3, -0.2, turn, -4.0, 7.0, heading])
    jacobian = pose_jacobian(both[:3], both[3:])
    assert_jacobian(lambda at: between(at[3:], at[:3]), jacobian, both, angles=[2])


def test_exp_is_a_rotation_about_a_point() -> None:
    """R(t) - I = V(t) J t, which the coordinates of `sigma_points` use; V is the mean of R over the turn."""
    t = np.array([0.0, 1e-300, 1e-9, 1e-4, 0.5, -2.0, math.pi, -6.0])
    np.testing.assert_allclose(rotation(t) - np.eye(2), mean_rotation(t) @ J * t[:, None, None], rtol=0, atol=1e-15)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    mean = 0.5 * np.einsum("k,tkij->tij", weights, rotation(np.outer(t, 0.5 * (nodes + 1.0))))
    np.testing.assert_allclose(mean_rotation(t), mean, rtol=0, atol=1e-14)


# --- sigma points --------------------------------------------------------------------------------


def test_moments_are_exact_for_parabolas_of_one_variable_and_for_lines() -> None:
    """Mean and variance of a + bx + cx^2 for x ~ N(0, sigma^2), and of a plane."""
    slope, bend, sigma = 1.3, -0.4, 0.7
    points = SPREAD * sigma * np.array([[1.0], [-1.0]])
    mean, cov = moments(slope * points + bend * points**2)
    variance = slope**2 * sigma**2 + 2.0 * bend**2 * sigma**4
    np.testing.assert_allclose([mean[0], cov[0, 0]], [bend * sigma**2, variance], rtol=1e-14)
    about = about_zero(slope * points + bend * points**2)
    np.testing.assert_allclose(about[0, 0], variance + bend**2 * sigma**4, rtol=1e-14)
    root = np.array([[1.0, 0.2], [0.2, 0.5]])
    plane = np.array([[2.0, 1.0], [-3.0, 0.1], [0.0, 1.0]])
    mean, cov = moments(SPREAD * np.vstack([root, -root]) @ plane.T)
    np.testing.assert_allclose(mean, 0.0, atol=1e-15)
    np.testing.assert_allclose(cov, plane @ root @ root @ plane.T, rtol=1e-13)


def test_roots_are_symmetric_and_singular_matrices_are_refused() -> None:
    root = np.random.default_rng(1).normal(size=(6, 6)) * np.logspace(0, -3, 6)
    cov = root @ root.T
    factor, inverse = symmetric_roots(cov)
    np.testing.assert_allclose(factor @ factor, cov, rtol=0, atol=1e-13)
    np.testing.assert_allclose(factor, factor.T, rtol=0, atol=1e-14)
    np.testing.assert_allclose(inverse @ factor, np.eye(6), rtol=0, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        symmetric_roots(root[:, :3] @ root[:, :3].T)


def test_motion_noise_equals_the_linear_filter_if_turn_and_translation_are_independent() -> None:
    turn, cov = rotation(0.7), np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 0.25]])
    whole = np.eye(3)
    whole[:2, :2] = turn
    np.testing.assert_allclose(motion_noise(turn, cov), whole @ cov @ whole.T, rtol=0, atol=1e-16)
    cov[2] = cov[:, 2] = 0.0  # a gyro without noise
    np.testing.assert_allclose(motion_noise(turn, cov), whole @ cov @ whole.T, rtol=0, atol=1e-16)


def test_motion_noise_has_the_second_moments_of_the_pose_error() -> None:
    """Compared with quadrature for correlated translation and turn: the second-order terms have an error below 1 %."""
    turn, line = rotation(-1.1), np.array([0.2, -0.1, 0.05])
    nodes, weights = np.polynomial.hermite_e.hermegauss(30)
    changes = np.array(
        [np.append(np.linalg.solve(mean_rotation(z * line[2]), turn @ (z * line[:2])), z * line[2]) for z in nodes]
    )
    exact = np.einsum("k,ki,kj->ij", weights / weights.sum(), changes, changes)
    whole = np.eye(3)
    whole[:2, :2] = turn
    linear = whole @ np.outer(line, line) @ whole.T
    added = np.abs(exact - linear).max()
    assert added > 1e-5
    np.testing.assert_allclose(motion_noise(turn, np.outer(line, line)), exact, rtol=0, atol=0.01 * added)


def test_a_new_landmark_has_the_covariance_of_its_observation() -> None:
    """For a large bearing noise: within 5 % of quadrature; the linear covariance has an error of a tenth."""
    start, z, cov = np.array([1.0, 2.0, 0.6]), np.array([5.0, 0.4]), np.diag([0.1, 0.3]) ** 2
    belief = InvariantBelief("range-bearing", start, np.zeros((3, 3)))
    belief.add(z[None], cov[None])
    nodes, weights = np.polynomial.hermite_e.hermegauss(30)
    r, b = np.meshgrid(z[0] + 0.1 * nodes, z[1] + 0.3 * nodes, indexing="ij")
    changes = np.stack([r * np.cos(b) - z[0] * np.cos(z[1]), r * np.sin(b) - z[0] * np.sin(z[1])], -1)
    exact = np.einsum("a,b,abi,abj->ij", weights, weights, changes, changes) / weights.sum() ** 2
    exact = rotation(0.6) @ exact @ rotation(0.6).T
    assert np.abs(belief.landmark_covs[0] - exact).max() < 0.05 * np.abs(exact).max()
    linear = RobocentricBelief("range-bearing", start, np.zeros((3, 3)))
    linear.add(z[None], cov[None])
    assert np.abs(linear.landmark_covs[0] - exact).max() > 0.08 * np.abs(exact).max()
    np.testing.assert_allclose(belief.landmarks[0], start[:2] + 5.0 * np.array([np.cos(1.0), np.sin(1.0)]), atol=1e-14)


def test_sigma_points_and_jacobians_differ_for_near_landmarks() -> None:
    """With less noise the difference is of second order."""
    apart = [differ(riukf, riekf, noise) for noise in (1.0, 0.1, 0.01)]
    assert apart[0] > 1e-3
    np.testing.assert_array_less(np.array(apart[1:]), np.array(apart[:-1]) / 30.0)


def differ(one: Estimator, other: Estimator, noise: float) -> float:
    """Return the largest distance of two filters' positions [m] on the same recording."""
    _, recording = random_recording(3, noise=noise, steps=40)
    return float(np.abs(between(one(recording).poses, other(recording).poses)).max())


def test_the_kalman_update_equals_the_textbook() -> None:
    rng = np.random.default_rng(2)
    root, H, R = rng.normal(size=(5, 5)), rng.normal(size=(4, 5)), block_diagonal(np.tile(np.eye(2), (2, 1, 1)))
    P, v = root @ root.T, rng.normal(size=4)
    step, cov, nis = kalman_step(P, H @ P, H @ P @ H.T + R, v, frames=1)
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(step, K @ v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cov, P - K @ S @ K.T, rtol=0, atol=1e-12)
    assert nis == pytest.approx(float(v @ np.linalg.inv(S) @ v))
