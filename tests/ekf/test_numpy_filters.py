"""The sigma-point right-invariant filter and the robocentric one: textbooks, Jacobians, consistency, refusals.

What they share with the family (names, frames, what cannot be observed) is in `test_laws`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from circles import STEPS, Estimator, additive_nees, invariant_nees, outside, run_all
from jacobians import assert_jacobian
from random_recordings import random_recording
from textbook_relatives import textbook_riukf, textbook_robocentric_ekf

from slamgauge.arrays import Float
from slamgauge.ekf import ekf, riekf, riukf, robocentric_ekf
from slamgauge.ekf.dense import block_diagonal, kalman_step, place_jacobian, times_rows
from slamgauge.ekf.kernels.models import SENSOR_CODES, locate, locate_all, observe, observe_all
from slamgauge.ekf.relatives import MovingBelief, RelativeFilter
from slamgauge.ekf.robocentric import RobocentricBelief, pose_jacobian
from slamgauge.ekf.sigma_points import (
    SPREAD,
    InvariantBelief,
    about_zero,
    exp_jacobian,
    moments,
    motion_noise,
    symmetric_roots,
)
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording, Sensor
from slamgauge.se2 import between, rotation

RELATIVES = pytest.mark.parametrize("estimator", [riukf, robocentric_ekf])
BELIEFS = pytest.mark.parametrize("belief_of", [InvariantBelief, RobocentricBelief])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
TEXTBOOKS = pytest.mark.parametrize(
    ("ours", "textbook"),
    [
        pytest.param(riukf, textbook_riukf, id="riukf"),
        pytest.param(robocentric_ekf, textbook_robocentric_ekf, id="robocentric-ekf"),
    ],
)
ANGLES = [0.0, 1e-9, 0.7, -2.0, math.pi - 1e-9, -math.pi + 1e-9]
J = np.array([[0.0, -1.0], [1.0, 0.0]])
BeliefOf = Callable[[str, Float, Float], MovingBelief]


# --- textbooks -----------------------------------------------------------------------------------


@TEXTBOOKS
@SENSORS
@pytest.mark.parametrize("seed", range(2))
def test_equals_the_textbook(ours: Estimator, textbook: Estimator, seed: int, sensor: str) -> None:
    recording = seen_again(random_recording(seed, sensor=sensor, steps=20)[1])
    assert_same(ours(recording), textbook(recording))


@TEXTBOOKS
def test_equals_the_textbook_from_a_fixed_start(ours: Estimator, textbook: Estimator) -> None:
    _, recording = random_recording(11, prior_sigmas=(0.0, 0.0, 0.0), slip=False, steps=30)
    assert_same(ours(recording), textbook(recording))


def seen_again(recording: Recording) -> Recording:
    """Every third observation a second time in its step, with noise of its own: first sights among them."""
    rng, count = np.random.default_rng(0), len(recording.observation)
    rows = np.sort(np.concatenate([np.arange(count), np.arange(0, count, 3)]))
    assert recording.landmark is not None
    return replace(
        recording,
        observation_step=recording.observation_step[rows],
        observation=recording.observation[rows] + 0.02 * rng.normal(size=(len(rows), 2)),
        observation_cov=recording.observation_cov[rows],
        landmark=recording.landmark[rows],
    )


def assert_same(actual: Estimate, expected: Estimate) -> None:
    turn = between(actual.poses, expected.poses)
    np.testing.assert_allclose(turn, np.zeros_like(turn), rtol=0, atol=1e-9)
    for name in ("pose_covs", "landmark_ids", "landmarks", "landmark_covs", "nis", "nis_dof"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


@SENSORS
def test_kernels_of_many_are_those_of_one(sensor: str) -> None:
    code, points = SENSOR_CODES[sensor], np.array([[3.0, -2.0], [0.005, 0.0], [0.0, 0.0], [1.0, 3.1]])
    for one, many in ((observe, observe_all), (locate, locate_all)):
        singly = np.array([one(code, *point) for point in points])
        values, jacobians = many(code, points)
        np.testing.assert_array_equal(np.column_stack([values, jacobians.reshape(-1, 4)]), singly)


# --- Jacobians -----------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", ANGLES)
def test_places_seen_from_a_robot(heading: float) -> None:
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
def test_pose_in_a_world_that_is_seen_from_the_robot(heading: float, turn: float) -> None:
    both = np.array([0.3, -0.2, turn, -4.0, 7.0, heading])
    jacobian = pose_jacobian(both[:3], both[3:])
    assert_jacobian(lambda at: between(at[3:], at[:3]), jacobian, both, angles=[2])


def test_exp_turns_about_where_it_must() -> None:
    """R(t) - I = V(t) J t, on which the coordinates of `sigma_points` rest; V is the mean of R over the turn."""
    t = np.array([0.0, 1e-300, 1e-9, 1e-4, 0.5, -2.0, math.pi, -6.0])
    np.testing.assert_allclose(rotation(t) - np.eye(2), exp_jacobian(t) @ J * t[:, None, None], rtol=0, atol=1e-15)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    mean = 0.5 * np.einsum("k,tkij->tij", weights, rotation(np.outer(t, 0.5 * (nodes + 1.0))))
    np.testing.assert_allclose(exp_jacobian(t), mean, rtol=0, atol=1e-14)


# --- sigma points --------------------------------------------------------------------------------


def test_moments_are_exact_for_parabolas_of_one_variable_and_for_lines() -> None:
    """Mean and variance of a + bx + cx^2 under N(0, sigma^2), and of a plane."""
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


def test_roots_are_symmetric_and_refuse_what_is_singular() -> None:
    root = np.random.default_rng(1).normal(size=(6, 6)) * np.logspace(0, -3, 6)
    cov = root @ root.T
    factor, inverse = symmetric_roots(cov)
    np.testing.assert_allclose(factor @ factor, cov, rtol=0, atol=1e-13)
    np.testing.assert_allclose(factor, factor.T, rtol=0, atol=1e-14)
    np.testing.assert_allclose(inverse @ factor, np.eye(6), rtol=0, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        symmetric_roots(root[:, :3] @ root[:, :3].T)


def test_motion_noise_is_that_of_the_linear_filter_where_turn_and_translation_are_independent() -> None:
    turn, cov = rotation(0.7), np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 0.25]])
    whole = np.eye(3)
    whole[:2, :2] = turn
    np.testing.assert_allclose(motion_noise(turn, cov), whole @ cov @ whole.T, rtol=0, atol=1e-16)
    cov[2] = cov[:, 2] = 0.0  # a gyro without noise
    np.testing.assert_allclose(motion_noise(turn, cov), whole @ cov @ whole.T, rtol=0, atol=1e-16)


def test_motion_noise_has_the_second_moments_of_what_noise_does_to_the_pose() -> None:
    """By quadrature, translation going with the turn: what the linear filter leaves out is right to 1 % of itself."""
    turn, line = rotation(-1.1), np.array([0.2, -0.1, 0.05])
    nodes, weights = np.polynomial.hermite_e.hermegauss(30)
    changes = np.array(
        [np.append(np.linalg.solve(exp_jacobian(z * line[2:])[0], turn @ (z * line[:2])), z * line[2]) for z in nodes]
    )
    exact = np.einsum("k,ki,kj->ij", weights / weights.sum(), changes, changes)
    whole = np.eye(3)
    whole[:2, :2] = turn
    linear = whole @ np.outer(line, line) @ whole.T
    added = np.abs(exact - linear).max()
    assert added > 1e-5
    np.testing.assert_allclose(motion_noise(turn, np.outer(line, line)), exact, rtol=0, atol=0.01 * added)


def test_a_new_landmark_has_the_covariance_of_its_sight() -> None:
    """Wide in bearing: within 5 % of quadrature of the sight's noise, where the linear covariance is a tenth off."""
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


def test_a_scan_of_near_landmarks_moves_sigma_points_and_jacobians_apart() -> None:
    """Otherwise both filters would be one; and with less noise they are, at second order."""
    apart = [differ(riukf, riekf, noise) for noise in (1.0, 0.1, 0.01)]
    assert apart[0] > 1e-3
    np.testing.assert_array_less(np.array(apart[1:]), np.array(apart[:-1]) / 30.0)


def differ(one: Estimator, other: Estimator, noise: float) -> float:
    """Largest distance of two filters' poses [m] on the same recording."""
    _, recording = random_recording(3, noise=noise, steps=40)
    return float(np.abs(between(one(recording).poses, other(recording).poses)).max())


# --- consistency ---------------------------------------------------------------------------------

RUNS = 30


@RELATIVES
def test_nis_and_nees_are_chi_square(estimator: Estimator) -> None:
    """Where the heading is known to 6 degrees, and the textbook filter's NEES leaves the band."""
    sensor: Sensor = "range-bearing"
    runs = run_all(estimator, sensor, 0.1, RUNS)
    nees = np.asarray(sum(additive_nees(*run) for run in runs))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0
    assert outside(total_nis(runs), total_dof(runs), 1) == 0
    of_textbook = np.asarray(sum(additive_nees(*run) for run in run_all(ekf, sensor, 0.1, RUNS)))
    assert outside(of_textbook, 3 * RUNS, STEPS + 1) > STEPS / 4


def test_nees_of_sigma_points_is_chi_square_even_when_the_heading_is_hardly_known() -> None:
    """12 degrees, in its own coordinates: the additive error is then curved."""
    nees = np.asarray(sum(invariant_nees(*run) for run in run_all(riukf, "position", 0.2, RUNS)))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0


def total_nis(runs: list[tuple[Float, Estimate]]) -> Float:
    return np.array(sum(float(run.nis.sum()) for _, run in runs if run.nis is not None))


def total_dof(runs: list[tuple[Float, Estimate]]) -> int:
    dof = sum(int(run.nis_dof.sum()) for _, run in runs if run.nis_dof is not None)
    assert dof > 9_000
    return dof


@pytest.mark.parametrize("sigma", [1.0, 1e6])
def test_doubt_about_the_worlds_place_never_moves_the_robocentric_estimate(sigma: float) -> None:
    """No sight depends on the world's frame: prior doubt in m, and of 0.3 rad, changes no pose and no landmark."""
    _, recording = random_recording(6, steps=60)
    doubtful = replace(recording, prior_cov=recording.prior_cov + np.diag([sigma, sigma, 0.3]) ** 2)
    sure, unsure = robocentric_ekf(recording), robocentric_ekf(doubtful)
    np.testing.assert_allclose(unsure.poses, sure.poses, rtol=0, atol=1e-12)
    if sigma > 1.0:
        with pytest.raises(UserError, match="so far apart"):
            ekf(doubtful)
    else:
        assert np.abs(ekf(doubtful).poses - ekf(recording).poses).max() > 0.01


# --- soundness -----------------------------------------------------------------------------------


@BELIEFS
def test_covariance_stays_symmetric_and_positive_semi_definite(belief_of: BeliefOf) -> None:
    """1000 steps to and fro without slip from a fixed start, so that it is singular at first."""
    slam = RelativeFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
    rng = np.random.default_rng(0)
    positions = rng.uniform(-8, 8, (6, 2))
    values = np.column_stack([np.hypot(*positions.T), np.arctan2(positions[:, 1], positions[:, 0])])
    covs = np.tile(np.diag([0.1, np.deg2rad(5)]) ** 2, (6, 1, 1))
    for k in range(1000):
        slam.predict([0.1 if k % 2 else -0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        slam.update(Observations(np.arange(6), values + rng.normal(size=values.shape) * [0.1, np.deg2rad(5)], covs))
        if k % 100 == 0 or k > 990:
            eigenvalues = np.linalg.eigvalsh(slam.belief.cov)
            assert eigenvalues[0] > -1e-15 * eigenvalues[-1]
            assert np.array_equal(slam.belief.cov, slam.belief.cov.T)
    assert np.abs(between(slam.pose, np.zeros(3))).max() < 0.5


def test_a_landmark_at_the_robot_gives_no_bearing_and_no_division_by_zero() -> None:
    """Sigma points refuse it: along the line of sight they have none of such a landmark."""
    sight = Observations(np.array([1]), np.array([[0.0, 0.3]]), np.diag([0.01, 0.01])[None])
    invariant, robocentric = (
        RelativeFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
        for belief_of in (InvariantBelief, RobocentricBelief)
    )
    invariant.update(sight)
    with pytest.raises(UserError, match="no update exists"):
        invariant.update(sight)
    robocentric.update(sight)
    nis, dof = robocentric.update(sight)
    assert dof < 2
    assert np.isfinite(nis)
    assert np.isfinite(robocentric.landmarks).all()


# --- refusals ------------------------------------------------------------------------------------


@RELATIVES
def test_what_it_cannot_use_is_refused_in_one_line(estimator: Estimator) -> None:
    _, recording = random_recording(4)
    bearings = replace(recording, sensor="bearing", observation=recording.observation[:, 1:], observation_cov=np.eye(1))
    with pytest.raises(UserError, match=r"^sensor: 'bearing' does not fit this filter; use one of range-bearing"):
        estimator(bearings)
    with pytest.raises(UserError, match=r"^landmark: this filter needs known association; give the ids"):
        estimator(replace(recording, landmark=None))


@BELIEFS
@pytest.mark.parametrize("broken", ["increment", "motion", "value", "cov", "id"])
def test_bad_numbers_are_refused_and_leave_the_filter_as_it_was(belief_of: BeliefOf, broken: str) -> None:
    _, recording = random_recording(4)
    slam = RelativeFilter("range-bearing", belief_of("range-bearing", recording.prior_mean, recording.prior_cov))
    scan = next(s for s in recording.scans() if len(s.value) > 1)
    assert scan.landmark is not None
    slam.update(scan)
    before = slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids
    values, new = scan.value.copy(), scan.landmark.copy()
    values[-1, 0] = np.nan
    new[-1] = 77
    spoilt = {
        "increment": (r"^increment = .*finite", lambda: slam.predict([np.nan, 0, 0], np.eye(3))),
        "motion": (r"^increment_cov = .*negative", lambda: slam.predict(np.zeros(3), -np.eye(3))),
        "value": (r"^observation\[.*finite", lambda: slam.update(Observations(new, values, scan.cov))),
        "cov": (r"^observation_cov\[.*negative", lambda: slam.update(Observations(new, scan.value, -scan.cov))),
        "id": (r"^landmark\[0\] = -1", lambda: slam.update(Observations(-1 - 0 * new, scan.value, scan.cov))),
    }
    said, call = spoilt[broken]
    with pytest.raises(UserError, match=said):
        call()
    after = slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


@BELIEFS
def test_a_step_without_observations_changes_nothing(belief_of: BeliefOf) -> None:
    _, recording = random_recording(0)
    slam = RelativeFilter("range-bearing", belief_of("range-bearing", recording.prior_mean, recording.prior_cov))
    slam.update(next(recording.scans()))
    before = slam.pose, slam.landmarks, slam.belief.cov
    nothing = Observations(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert slam.update(nothing) == (0.0, 0)
    for actual, expected in zip((slam.pose, slam.landmarks, slam.belief.cov), before, strict=True):
        np.testing.assert_array_equal(actual, expected)


def test_kalmans_step_is_the_textbooks() -> None:
    rng = np.random.default_rng(2)
    root, H, R = rng.normal(size=(5, 5)), rng.normal(size=(4, 5)), block_diagonal(np.tile(np.eye(2), (2, 1, 1)))
    P, v = root @ root.T, rng.normal(size=4)
    step, cov, nis = kalman_step(P, H @ P, H @ P @ H.T + R, v, frames=1)
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(step, K @ v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cov, P - K @ S @ K.T, rtol=0, atol=1e-12)
    assert nis == pytest.approx(float(v @ np.linalg.inv(S) @ v))
