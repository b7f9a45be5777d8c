"""The sliding-window filter: comparison with a textbook and with the optimum, consistency, refusals."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.compare.datasets.victoria_park import read_victoria_park
from slamgauge.ekf import SlidingWindowFilter, riekf, sliding_window
from slamgauge.ekf.advanced.window import gauss_newton, marginal_prior
from slamgauge.ekf.estimators import drive
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between, chain, wrap
from tests.reference.circles import STEPS, additive_nees, back_and_forth, covs_of, outside, run_all
from tests.reference.random_recordings import random_recording, recording_of
from tests.reference.textbook_window import textbook_sliding_window

pytestmark = pytest.mark.slow

VICTORIA_PARK = Path(__file__).parents[2] / "../shared/data/victoria_park/victoria_park.txt"
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])


@pytest.fixture
def to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Iterate the Gauss-Newton steps to convergence."""
    monkeypatch.setattr(gauss_newton, "CLOSE", 1e-11)


def off(estimate: Estimate, optimum: Estimate) -> tuple[Float, Float]:
    """Return the largest distances of positions, headings and sigmas of two estimates, in sigmas of the second."""
    sigmas, own = (np.sqrt(np.diagonal(covs_of(each), axis1=1, axis2=2)) for each in (optimum, estimate))
    apart = estimate.poses - optimum.poses
    apart[:, 2] = wrap(apart[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):  # the start may be exact
        return np.abs(apart / sigmas).max(axis=1), np.abs(own / sigmas - 1.0).max(axis=1)


# --- references ----------------------------------------------------------------------------------


@pytest.mark.full  # others are usual
@pytest.mark.usefixtures("to_the_end")
@SENSORS
@pytest.mark.parametrize("lag", [1, 4])
def test_equals_the_textbook(sensor: str, lag: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without regularising noise, which is a thousandth of the motion noise.

    Filter and textbook reach the minimum by different steps and linearise there: a difference of third order.
    """
    monkeypatch.setattr(marginal_prior, "REGULARISING_SIGMA", 0.0)
    monkeypatch.setattr(marginal_prior, "REGULARISING_SHARE", 0.0)
    recording = replace(recording_of(sensor, 3).first(11), prior_mean=np.array([0.0, 0.0, 0.4]))
    actual, expected = sliding_window(recording, lag), textbook_sliding_window(recording, lag)
    assert actual.landmark_ids is not None
    assert actual.landmarks is not None
    assert expected.landmarks is not None
    np.testing.assert_array_equal(actual.landmark_ids, expected.landmark_ids)
    np.testing.assert_allclose(between(expected.poses, actual.poses), 0.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(covs_of(actual), covs_of(expected), rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(actual.landmarks, expected.landmarks, atol=1e-5)


@pytest.mark.usefixtures("to_the_end")
@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("noise", [1.0, 0.01])
def test_a_window_that_holds_everything_is_the_optimum(sensor: str, noise: float) -> None:
    """For motions with isotropic noise, which is the same in every frame."""
    _, recording = random_recording(0, sensor=sensor, noise=noise)
    isotropic = np.diag([0.03, 0.03, 0.01]) ** 2 * noise**2
    recording = replace(recording, odometry_cov=np.tile(isotropic, (recording.steps, 1, 1)))
    for steps in (12, recording.steps):
        part = recording.first(steps)
        poses, sigmas = off(sliding_window(part, lag=steps), batch(part))
        assert poses[-1] < 1e-5
        assert sigmas[-1] < 1e-4


@pytest.mark.full  # others are usual
@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("scenario", ["q1-short-dense", "q4-ring"])
def test_a_window_that_holds_everything_is_the_causal_optimum(scenario: str, fixed: bool) -> None:
    """The causal optimum has motion noise in another frame, rotated by 0.01 or 0.02 rad.

    `fixed` is an exact start. Medians are compared, because bearings may place a landmark one step earlier.
    """
    recording = simulate(load_scenario(scenario, ["start=sampled"]), 0)[1].first(90)
    if fixed:
        recording = replace(recording, prior_cov=np.zeros((3, 3)))
    poses, sigmas = off(sliding_window(recording, lag=90), causal(recording))
    assert np.median(poses[5:]) < 0.05
    assert np.median(sigmas[5:]) < 0.02
    assert poses[-1] < 0.05


# --- bearing-only --------------------------------------------------------------------------------


def seen_early_and_late() -> Recording:
    """Return bearings of landmarks that are not placed at first and come back into view."""
    scenario = load_scenario("q4-ring", ["start=sampled", "landmarks.positions=[[-3.0, 1.0], [-5.0, -2.0]]"])
    return simulate(scenario, 3)[1].first(560)


def test_observations_of_unplaced_landmarks_are_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """After nearly a loop the robot re-observes landmarks that it could not place at the start.

    Compared are the relative differences of sigmas from the optimum. Other seeds give 0.23 and 0.17 with the early
    observations, 0.38 and 0.50 without.
    """
    recording = seen_early_and_late()
    optimum = causal(recording)
    _, kept = off(sliding_window(recording, lag=60), optimum)
    monkeypatch.setattr("slamgauge.ekf.advanced.sliding_window.KEPT", 0.0)
    _, lost = off(sliding_window(recording, lag=60), optimum)
    assert kept[400:].max() < 0.2
    assert lost[400:].max() > 0.3


def test_the_number_of_kept_poses_is_bounded() -> None:
    recording = seen_early_and_late().first(120)
    slam = SlidingWindowFilter("bearing", recording.prior_mean, recording.prior_cov, lag=8)
    assert max(len(slam.kept_poses) for _ in drive(slam, recording)) == 4


# --- consistency ---------------------------------------------------------------------------------

RUNS = 30


def test_nees_is_chi_square() -> None:
    """With a heading uncertainty of 6 degrees, 99 % bands of every step."""
    runs = run_all(lambda recording: sliding_window(recording, lag=10), "range-bearing", 0.1, RUNS)
    nees = np.asarray(sum(additive_nees(*run) for run in runs))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0


@SENSORS
@pytest.mark.parametrize("lag", [3, 30])
def test_translation_and_rotation_of_the_whole_map_stay_unobservable(sensor: str, lag: int) -> None:
    """Prior covariance S of the world frame (1 m, 2 m, 0.1 rad) adds N S N' to every pose, N = [I, J p; 0, 1].

    The filter computes covariances at the start of its last Gauss-Newton step.
    """
    recording = recording_of(sensor, 6)
    S = np.diag([1.0, 4.0, 0.01])

    def world(positions: Float) -> Float:
        N = np.tile(np.eye(3), (len(positions), 1, 1))
        N[:, 0, 2], N[:, 1, 2] = -positions[:, 1], positions[:, 0]
        return N @ S @ N.swapaxes(1, 2)

    doubtful = replace(recording, prior_cov=recording.prior_cov + world(recording.prior_mean[None, :2])[0])
    sure, unsure = (sliding_window(each, lag) for each in (recording, doubtful))
    np.testing.assert_allclose(unsure.poses, sure.poses, rtol=0, atol=1e-4)
    expected = covs_of(sure) + world(sure.poses[:, :2])
    sigmas = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    scale = sigmas[:, :, None] * sigmas[:, None, :]
    np.testing.assert_allclose(covs_of(unsure) / scale, expected / scale, rtol=0, atol=0.01)


def test_on_a_recorded_drive_it_is_near_the_optimum() -> None:
    """500 steps of Victoria Park, with three loops: the textbook filter is 0.7 m off by then."""
    if not VICTORIA_PARK.is_file():
        pytest.skip(f"{VICTORIA_PARK} is not there")
    recording = read_victoria_park(VICTORIA_PARK).first(501)
    ours, optimum = sliding_window(recording, lag=10), causal(recording)
    assert np.hypot(*(ours.poses - optimum.poses)[:, :2].T).max() < 0.1
    _, sigmas = off(ours, replace(optimum, pose_covs=covs_of(optimum) + 1e-9 * np.eye(3)))
    assert sigmas[100:].max() < 0.1


# --- soundness -----------------------------------------------------------------------------------


def test_the_information_stays_semidefinite_over_many_steps() -> None:
    """1000 steps back and forth without slip from a fixed start."""
    slam = SlidingWindowFilter("range-bearing", np.zeros(3), np.zeros((3, 3)), lag=5)
    for k in back_and_forth(slam, 1000):
        if k % 100 == 0:
            assert np.linalg.eigvalsh(slam.pose_cov)[0] > -1e-18
            assert np.linalg.eigvalsh(slam.landmark_covs).min() > 0.0
    assert np.abs(between(slam.pose, np.zeros(3))).max() < 0.5


def test_results_far_from_the_origin_are_the_same() -> None:
    recording = recording_of("bearing", 8)
    there = replace(recording, prior_mean=recording.prior_mean + np.array([4e6, -3e5, 0.0]))
    here, far = sliding_window(recording, 10), sliding_window(there, 10)
    np.testing.assert_allclose(far.poses - [4e6, -3e5, 0.0], here.poses, atol=1e-8)
    np.testing.assert_allclose(covs_of(far), covs_of(here), rtol=1e-6, atol=1e-12)


def test_a_scan_may_come_in_two_parts() -> None:
    _, recording = random_recording(2, steps=6)
    whole, parts = (SlidingWindowFilter("range-bearing", recording.prior_mean, recording.prior_cov) for _ in range(2))
    for step, scan in enumerate(recording.scans()):
        for slam in (whole, parts):
            if step:
                slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        assert scan.landmark is not None
        whole.update(scan)
        for half in (slice(None, 2), slice(2, None)):
            parts.update(Observations(scan.landmark[half], scan.value[half], scan.cov[half]))
    np.testing.assert_allclose(parts.pose, whole.pose, atol=1e-3)
    np.testing.assert_allclose(parts.pose_cov, whole.pose_cov, rtol=0.01, atol=1e-9)


def far_and_near(seed: int) -> Recording:
    """Return bearings of five near landmarks, and of one at the horizon."""
    rng, steps = np.random.default_rng(seed), 450
    increments = np.tile([0.05, 0.0, 0.02], (steps, 1))
    cov = np.diag([0.01, 0.002, 0.005]) ** 2
    poses = chain(np.zeros(3), increments + rng.multivariate_normal(np.zeros(3), cov, steps))
    places = np.vstack([rng.uniform(-6.0, 6.0, (5, 2)), [1000.0, 1000.0]])
    offset = places[None] - poses[:, None, :2]
    bearings = np.arctan2(offset[..., 1], offset[..., 0]) - poses[:, None, 2] + 0.02 * rng.normal(size=(steps + 1, 6))
    return Recording(
        stamps=np.asarray(0.1 * np.arange(steps + 1), np.float64),
        prior_mean=np.zeros(3),
        prior_cov=1e-6 * np.eye(3),
        odometry=increments,
        odometry_cov=cov,
        sensor="bearing",
        observation_step=np.repeat(np.arange(steps + 1), 6),
        observation=np.asarray(wrap(bearings)).reshape(-1, 1),
        observation_cov=np.array([[0.02**2]]),
        landmark=np.tile(np.arange(6), steps + 1),
    )


@pytest.mark.full  # another seed is in the usual run
@pytest.mark.parametrize("seed", range(3))
def test_a_landmark_at_the_horizon_causes_no_error(seed: int) -> None:
    estimate = sliding_window(far_and_near(seed), lag=60)
    assert estimate.landmark_ids is not None
    assert {*range(5)} <= {*estimate.landmark_ids.tolist()}
    assert estimate.landmark_covs is not None
    assert np.linalg.eigvalsh(estimate.landmark_covs).min() > 0.0


def test_a_failed_marginalisation_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    slam = SlidingWindowFilter("bearing", recording.prior_mean, recording.prior_cov, lag=3)
    assert len([*drive(slam, recording.first(6))]) == 7
    before = (slam.pose, slam.pose_cov, slam.landmarks, slam.kept_poses, slam.provisional)

    def exhausted(*_: object) -> None:
        raise np.linalg.LinAlgError

    for name in ("without_first", "with_first_kept", "without_kept"):
        monkeypatch.setattr(marginal_prior, name, exhausted)
    with pytest.raises(UserError, match=r"^increment: cannot marginalise the window's first pose; its standard dev"):
        slam.predict([0.1, 0.0, 0.0], 0.01 * np.eye(3))
    after = (slam.pose, slam.pose_cov, slam.landmarks, slam.kept_poses, slam.provisional)
    for was, has in zip(before, after, strict=True):
        np.testing.assert_equal(has, was)


def test_steps_without_convergence_are_refused_while_landmarks_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    slam = SlidingWindowFilter("bearing", recording.prior_mean, recording.prior_cov, lag=6)
    assert len([*drive(slam, recording.first(11))]) == 12
    *_, last = recording.first(12).scans()
    slam.predict(recording.odometry[11], recording.odometry_cov[11])
    new = Observations(np.array([77]), np.array([[0.3]]), np.array([[[0.01]]]))
    slam.update(new)
    before = pickle.dumps(vars(slam))
    assert 77 in slam.provisional
    with monkeypatch.context() as patch:
        patch.setattr(gauss_newton, "MAX_STEPS", 0)
        with pytest.raises(UserError, match=r"^observation: no update exists for this scan; [^\n]*$"):
            slam.update(last)
    assert pickle.dumps(vars(slam)) == before
    slam.update(last)


@SENSORS
def test_copies_are_independent(sensor: str) -> None:
    recording = recording_of(sensor, 3).first(12)
    whole = sliding_window(recording, lag=4)
    slam, poses = SlidingWindowFilter(sensor, recording.prior_mean, recording.prior_cov, lag=4), []
    for step, scan in enumerate(recording.scans()):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan)
        poses.append(slam.pose)
        left, slam = slam, (copy.deepcopy(slam) if step % 2 else pickle.loads(pickle.dumps(slam)))
        left.predict([9.0, 0.0, 0.0], np.eye(3))
    np.testing.assert_array_equal(poses, whole.poses)


def test_a_window_that_needs_too_much_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 10_000.0)
    window = f"and a window of {recording.steps} steps needs"
    with pytest.raises(UserError, match=rf"^the covariance of \d+ landmarks {window} .*; give fewer landmarks, or"):
        sliding_window(recording, lag=10_000)


def test_a_landmark_at_the_sensor_waits_for_another_observation() -> None:
    slam = SlidingWindowFilter("range-bearing", np.zeros(3), 0.01 * np.eye(3), lag=3)
    slam.update(Observations(np.array([4]), np.array([[0.0, 0.0]]), 0.01 * np.eye(2)[None]))
    assert slam.provisional == {4: 0}
    assert slam.landmark_covs.shape == (0, 2, 2)
    assert slam.standing(np.array([4])).tolist() == [-1]
    slam.predict([-1.0, 0.0, 0.0], 0.01 * np.eye(3))
    slam.update(
        Observations(np.array([4, 4]), np.array([[1.0, 0.1], [1.1, 0.0]]), np.tile(0.01 * np.eye(2), (2, 1, 1)))
    )
    assert slam.landmark_ids.tolist() == [4]
    assert np.hypot(*slam.landmarks[0]) < 0.3


# --- refusals ------------------------------------------------------------------------------------


def test_unsuitable_input_is_refused() -> None:
    _, recording = random_recording(4)
    with pytest.raises(UserError, match=r"^landmark: this filter needs known association; give the ids"):
        sliding_window(replace(recording, landmark=None))
    for lag in (0, -1, 2.5, True, None):
        with pytest.raises(UserError, match=rf"^lag: {lag} steps leave no window; give a whole number, at least 1"):
            SlidingWindowFilter("position", np.zeros(3), np.eye(3), lag)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(UserError, match=r"^sensor: 'sonar' does not fit this filter"):
        SlidingWindowFilter("sonar", np.zeros(3), np.eye(3))


@pytest.mark.parametrize(("value", "cov"), [(3.0, 0.0), (1e40, 1e-80)])
def test_a_refused_observation_changes_nothing(value: float, cov: float) -> None:
    _, recording = random_recording(4)
    slam = SlidingWindowFilter("range-bearing", recording.prior_mean, recording.prior_cov, lag=3)
    assert len([*drive(slam, recording.first(8))]) == 9
    before = (slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids)
    values, covs = np.array([[2.0, 0.1], [value, 0.2]]), np.stack([np.eye(2), cov * np.eye(2)])
    with pytest.raises(UserError):
        slam.update(Observations(np.array([99, 1]), values, covs))
    after = (slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids)
    for was, has in zip(before, after, strict=True):
        np.testing.assert_array_equal(has, was)
    slam.predict([0.1, 0.0, 0.0], 0.01 * np.eye(3))


def test_without_observations_it_is_dead_reckoning() -> None:
    _, recording = random_recording(4, steps=30)
    blind = replace(
        recording,
        observation_step=np.zeros(0, np.int64),
        observation=np.zeros((0, 2)),
        observation_cov=np.zeros((0, 2, 2)),
        landmark=np.zeros(0, np.int64),
    )
    ours, theirs = sliding_window(blind, lag=4), riekf(blind)
    np.testing.assert_allclose(between(theirs.poses, ours.poses), 0.0, atol=1e-12)
    np.testing.assert_allclose(covs_of(ours), covs_of(theirs), rtol=1e-9, atol=1e-15)
