"""The sigma-point right-invariant filter and the robocentric one: textbooks, consistency, refusals.

What they share with the family (names, frames, what cannot be observed) is in `test_laws`, their parts are in
`test_numpy_filter_parts`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, riukf, robocentric_ekf
from slamgauge.ekf.advanced.numpy_filter import MovingBelief, NumpyFilter
from slamgauge.ekf.advanced.robocentric import RobocentricBelief
from slamgauge.ekf.advanced.sigma_points import (
    InvariantBelief,
)
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between
from slamgauge.sensors import Sensor
from tests.reference.circles import STEPS, Estimator, additive_nees, invariant_nees, outside, run_all
from tests.reference.random_recordings import random_recording
from tests.reference.textbook_numpy_filters import textbook_riukf, textbook_robocentric_ekf

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
    of_textbook = np.asarray(sum(additive_nees(*run) for run in run_all(ekf_slam, sensor, 0.1, RUNS)))
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
            ekf_slam(doubtful)
    else:
        assert np.abs(ekf_slam(doubtful).poses - ekf_slam(recording).poses).max() > 0.01


# --- soundness -----------------------------------------------------------------------------------


@BELIEFS
def test_covariance_stays_symmetric_and_positive_semi_definite(belief_of: BeliefOf) -> None:
    """1000 steps to and fro without slip from a fixed start, so that it is singular at first."""
    slam = NumpyFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
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
        NumpyFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
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
    slam = NumpyFilter("range-bearing", belief_of("range-bearing", recording.prior_mean, recording.prior_cov))
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
    slam = NumpyFilter("range-bearing", belief_of("range-bearing", recording.prior_mean, recording.prior_cov))
    slam.update(next(recording.scans()))
    before = slam.pose, slam.landmarks, slam.belief.cov
    nothing = Observations(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert slam.update(nothing) == (0.0, 0)
    for actual, expected in zip((slam.pose, slam.landmarks, slam.belief.cov), before, strict=True):
        np.testing.assert_array_equal(actual, expected)
