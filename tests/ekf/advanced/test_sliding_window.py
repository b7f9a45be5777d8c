"""The sliding-window filter: a textbook, the optimum that it becomes, consistency, soundness, refusals."""

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
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between, chain, wrap
from tests.reference.circles import STEPS, additive_nees, outside, run_all
from tests.reference.random_recordings import random_recording, recording_of
from tests.reference.textbook_window import textbook_sliding_window

VICTORIA_PARK = Path(__file__).parents[2] / "../shared/data/victoria_park/victoria_park.txt"
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])


@pytest.fixture
def to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps until nothing moves any more."""
    monkeypatch.setattr(gauss_newton, "CLOSE", 1e-11)


def off(estimate: Estimate, optimum: Estimate) -> tuple[Float, Float]:
    """How far poses (N+1,) and sigmas (N+1,) are from another's, in sigmas of the latter: the largest of three."""
    sigmas, own = (np.sqrt(np.diagonal(covs_of(each), axis1=1, axis2=2)) for each in (optimum, estimate))
    apart = estimate.poses - optimum.poses
    apart[:, 2] = wrap(apart[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):  # a start may be known exactly
        return np.abs(apart / sigmas).max(axis=1), np.abs(own / sigmas - 1.0).max(axis=1)


def covs_of(estimate: Estimate) -> Float:
    assert estimate.pose_covs is not None
    return estimate.pose_covs


# --- what it equals ------------------------------------------------------------------------------


@pytest.mark.usefixtures("to_the_end")
@SENSORS
@pytest.mark.parametrize("lag", [1, 4])
def test_equals_the_textbook(sensor: str, lag: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what is lent to motions that are inverted, which is a thousandth of their noise.

    The steps to each minimum are not the same, and errors are counted from where each ends: that is of third order.
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
    """Of motions whose noise is the same in every direction, and so in every frame."""
    _, recording = random_recording(0, sensor=sensor, noise=noise)
    isotropic = np.diag([0.03, 0.03, 0.01]) ** 2 * noise**2
    recording = replace(recording, odometry_cov=np.tile(isotropic, (recording.steps, 1, 1)))
    for steps in (12, recording.steps):
        part = recording.first(steps)
        poses, sigmas = off(sliding_window(part, lag=steps), batch(part))
        assert poses[-1] < 1e-5
        assert sigmas[-1] < 1e-4


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("scenario", ["q1-short-dense", "q4-ring"])
def test_a_window_that_holds_everything_is_the_causal_optimum(scenario: str, fixed: bool) -> None:
    """Whose motions have their noise in another frame, turned by .01 or .02 rad.

    Fixed is a start that is known exactly. In the median: bearings place a landmark a step sooner here or there.
    """
    recording = simulate(load_scenario(scenario, ["start=sampled"]), 0)[1].first(90)
    if fixed:
        recording = replace(recording, prior_cov=np.zeros((3, 3)))
    poses, sigmas = off(sliding_window(recording, lag=90), causal(recording))
    assert np.median(poses[5:]) < 0.05
    assert np.median(sigmas[5:]) < 0.02
    assert poses[-1] < 0.05


# --- bearings alone ------------------------------------------------------------------------------


def seen_early_and_late() -> Recording:
    """Landmarks behind the robot that their first bearings do not place, and that come back into view."""
    scenario = load_scenario("q4-ring", ["start=sampled", "landmarks.positions=[[-3.0, 1.0], [-5.0, -2.0]]"])
    return simulate(scenario, 3)[1].first(560)


def test_what_an_unplaced_landmark_was_seen_at_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nearly a round later the robot meets the landmarks again that it saw at the start, before they could be placed.

    What its sigmas then lack beside the optimum's. From other seeds: .23 and .17 with them, .38 and .50 without.
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
    most = 0
    for step, scan in enumerate(recording.scans()):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan)
        most = max(most, len(slam.kept_poses))
    assert most == 4


# --- consistency ---------------------------------------------------------------------------------

RUNS = 30


def test_nees_is_chi_square() -> None:
    """Where the heading is known to 6 degrees, 99 % bands of every step."""
    runs = run_all(lambda recording: sliding_window(recording, lag=10), "range-bearing", 0.1, RUNS)
    nees = np.asarray(sum(additive_nees(*run) for run in runs))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0


@SENSORS
@pytest.mark.parametrize("lag", [3, 30])
def test_shift_and_turn_of_the_whole_map_are_never_learnt(sensor: str, lag: int) -> None:
    """Doubt S about the world's place, of 1 m, 2 m and .1 rad, is left at every pose: N S N', N = [I, J p; 0, 1].

    Covariances are those of where the last step to a minimum began.
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


def test_on_a_recorded_drive_it_stays_with_the_optimum() -> None:
    """500 steps of Victoria Park, with three loops: the textbook filter is 0.7 m off by then."""
    if not VICTORIA_PARK.is_file():
        pytest.skip(f"{VICTORIA_PARK} is not there")
    recording = read_victoria_park(VICTORIA_PARK).first(501)
    ours, optimum = sliding_window(recording, lag=10), causal(recording)
    assert np.hypot(*(ours.poses - optimum.poses)[:, :2].T).max() < 0.1
    _, sigmas = off(ours, replace(optimum, pose_covs=covs_of(optimum) + 1e-9 * np.eye(3)))
    assert sigmas[100:].max() < 0.1


# --- soundness -----------------------------------------------------------------------------------


def test_the_information_stays_sound_over_many_steps() -> None:
    """1000 steps to and fro without slip from a fixed start."""
    slam = SlidingWindowFilter("range-bearing", np.zeros(3), np.zeros((3, 3)), lag=5)
    rng = np.random.default_rng(0)
    positions = rng.uniform(-8, 8, (6, 2))
    values = np.column_stack([np.hypot(*positions.T), np.arctan2(positions[:, 1], positions[:, 0])])
    covs = np.tile(np.diag([0.1, np.deg2rad(5)]) ** 2, (6, 1, 1))
    for k in range(1000):
        slam.predict([0.1 if k % 2 else -0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        slam.update(Observations(np.arange(6), values + rng.normal(size=values.shape) * [0.1, np.deg2rad(5)], covs))
        if k % 100 == 0:
            assert np.linalg.eigvalsh(slam.pose_cov)[0] > -1e-18
            assert np.linalg.eigvalsh(slam.landmark_covs).min() > 0.0
    assert np.abs(between(slam.pose, np.zeros(3))).max() < 0.5


def test_far_from_the_origin_it_is_the_same() -> None:
    recording = recording_of("bearing", 8)
    there = replace(recording, prior_mean=recording.prior_mean + np.array([4e6, -3e5, 0.0]))
    here, far = sliding_window(recording, 10), sliding_window(there, 10)
    np.testing.assert_allclose(far.poses - [4e6, -3e5, 0.0], here.poses, atol=1e-8)
    np.testing.assert_allclose(covs_of(far), covs_of(here), rtol=1e-6, atol=1e-12)


def test_a_scan_in_two_parts_is_one_scan() -> None:
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
    """Bearings of five landmarks nearby, and of one on the horizon, which a pass hardly moves."""
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


@pytest.mark.parametrize("seed", range(3))
def test_a_landmark_on_the_horizon_ends_no_run(seed: int) -> None:
    estimate = sliding_window(far_and_near(seed), lag=60)
    assert estimate.landmark_ids is not None
    assert {*range(5)} <= {*estimate.landmark_ids.tolist()}
    assert estimate.landmark_covs is not None
    assert np.linalg.eigvalsh(estimate.landmark_covs).min() > 0.0


def test_what_its_first_pose_leaves_behind_is_all_or_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    slam = SlidingWindowFilter("bearing", recording.prior_mean, recording.prior_cov, lag=3)
    for step, scan in enumerate(recording.first(6).scans()):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan)
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


def test_steps_that_do_not_end_are_refused_while_landmarks_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    slam = SlidingWindowFilter("bearing", recording.prior_mean, recording.prior_cov, lag=6)
    scans = list(recording.first(12).scans())
    for step, scan in enumerate(scans[:-1]):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan)
    slam.predict(recording.odometry[len(scans) - 2], recording.odometry_cov[len(scans) - 2])
    new = Observations(np.array([77]), np.array([[0.3]]), np.array([[[0.01]]]))
    slam.update(new)
    before = pickle.dumps(vars(slam))
    assert 77 in slam.provisional
    with monkeypatch.context() as patch:
        patch.setattr(gauss_newton, "MAX_STEPS", 0)
        with pytest.raises(UserError, match=r"^observation: no update exists for this scan; [^\n]*$"):
            slam.update(scans[-1])
    assert pickle.dumps(vars(slam)) == before
    slam.update(scans[-1])


@SENSORS
def test_copies_go_on_by_themselves(sensor: str) -> None:
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


def test_a_window_that_outgrows_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recording_of("bearing", 3)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 10_000.0)
    window = f"beside a window of {recording.steps} steps needs"
    with pytest.raises(UserError, match=rf"^the covariance of \d+ landmarks {window} .*; give fewer landmarks, or"):
        sliding_window(recording, lag=10_000)


def test_a_landmark_at_the_sensor_waits_for_another_sight() -> None:
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


def test_what_it_cannot_use_is_refused_in_one_line() -> None:
    _, recording = random_recording(4)
    with pytest.raises(UserError, match=r"^landmark: this filter needs known association; give the ids"):
        sliding_window(replace(recording, landmark=None))
    for lag in (0, -1, 2.5, True, None):
        with pytest.raises(UserError, match=rf"^lag: {lag} steps leave no window; give a whole number, at least 1"):
            SlidingWindowFilter("position", np.zeros(3), np.eye(3), lag)  # pyright: ignore[reportArgumentType]
    with pytest.raises(UserError, match=r"^sensor: 'sonar' does not fit this filter"):
        SlidingWindowFilter("sonar", np.zeros(3), np.eye(3))


@pytest.mark.parametrize("broken", ["increment", "motion", "value", "cov", "id", "huge"])
def test_bad_numbers_are_refused_and_leave_the_filter_as_it_was(broken: str) -> None:
    _, recording = random_recording(4)
    slam = SlidingWindowFilter("range-bearing", recording.prior_mean, recording.prior_cov, lag=3)
    for step, scan in enumerate(recording.first(8).scans()):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan)
    before = (slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids)
    ids, values, covs = np.array([99, 1]), np.array([[2.0, 0.1], [3.0, 0.2]]), np.tile(np.eye(2), (2, 1, 1))
    if broken == "value":
        values[1, 0] = -1.0
    if broken == "cov":
        covs[1] = 0.0
    if broken == "id":
        ids[1] = -1
    if broken == "huge":
        values[1, 0], covs[1] = 1e40, 1e-80 * np.eye(2)
    with pytest.raises(UserError):
        if broken == "increment":
            slam.predict([np.nan, 0.0, 0.0], np.eye(3))
        elif broken == "motion":
            slam.predict([0.1, 0.0, 0.0], -np.eye(3))
        else:
            slam.update(Observations(ids, values, covs))
    after = (slam.pose, slam.pose_cov, slam.landmarks, slam.landmark_covs, slam.landmark_ids)
    for was, has in zip(before, after, strict=True):
        np.testing.assert_array_equal(has, was)
    slam.predict([0.1, 0.0, 0.0], 0.01 * np.eye(3))


def test_blind_steps_are_dead_reckoning() -> None:
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
