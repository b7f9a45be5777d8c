"""The simulator: exact truths, independent streams, noise of the stated size.

Statistical tests use fixed seeds and two-sided bounds that a right simulator misses once in 10 000.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.truth import Truth

T = TypeVar("T")

FALSE_ALARM_RATE = 1e-4
POSITION = "sensor={kind='position', max_range=10, sigma_position=0.2}"


def scenario(*overrides: str) -> Scenario:
    return load_scenario("q1-long-dense", overrides)


def given(field: T | None) -> T:
    assert field is not None
    return field


def assert_chi_square(normalised: Float) -> None:
    """Squares of what should be independent standard normal numbers, summed, lie inside the bounds."""
    low, high = chi2.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], normalised.size)
    assert low < np.sum(normalised**2) < high


def true_body(truth: Truth, recording: Recording) -> Float:
    """The observed landmarks (M, 2) in the body frames of the true poses that observed them."""
    poses = given(truth.poses)[recording.observation_step]
    offsets = given(truth.landmarks)[given(truth.association)] - poses[:, :2]
    return np.einsum("nji,nj->ni", rotation(poses[:, 2]), offsets)


def sensor_noise(truth: Truth, recording: Recording) -> Float:
    body = true_body(truth, recording)
    if recording.sensor == "position":
        return recording.observation - body
    ranges = recording.observation[:, 0] - np.linalg.norm(body, axis=1)
    return np.column_stack([ranges, wrap(recording.observation[:, 1] - np.arctan2(body[:, 1], body[:, 0]))])


# --- truth -------------------------------------------------------------------------------------


def test_truth_follows_the_command_exactly():
    truth, recording = simulate(scenario(), 0)
    np.testing.assert_allclose(given(truth.poses), chain([0, 0, 0], np.tile([0.1, 0.0, 0.01], (1257, 1))), atol=1e-12)
    np.testing.assert_allclose(recording.stamps, 0.1 * np.arange(1258), rtol=1e-15)


def test_segments_follow_one_another():
    segments = "{step=0.5, segments=[{speed=2, yaw_rate=0, duration=1}, {speed=0, yaw_rate=1, duration=1.5}]}"
    truth, _ = simulate(scenario(f"trajectory={segments}"), 0)
    expected = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0.5], [2, 0, 1], [2, 0, 1.5]]
    np.testing.assert_allclose(given(truth.poses), expected, atol=1e-15)


def test_the_start_is_the_mean_or_drawn_from_the_prior():
    mean = ["prior.mean=[1, 2, 3]"]
    fixed, _ = simulate(scenario(*mean), 0)
    np.testing.assert_array_equal(given(fixed.poses)[0], [1, 2, 3])

    short = scenario(*mean, "start=sampled", "trajectory.duration=0.1")
    starts = np.array([given(simulate(short, seed)[0].poses)[0] for seed in range(300)])
    assert_chi_square((starts[:, :2] - [1, 2]) / 0.1)
    assert_chi_square(wrap(starts[:, 2] - 3) / 0.01)


def test_everything_in_range_is_seen_from_step_zero_on():
    truth, recording = simulate(scenario("sensor.min_range=3", "sensor.max_range=7"), 0)
    distance = np.linalg.norm(given(truth.poses)[:, None, :2] - given(truth.landmarks), axis=2)
    step, landmark = np.nonzero((distance >= 3) & (distance <= 7))
    assert step[0] == 0
    np.testing.assert_array_equal(recording.observation_step, step)
    np.testing.assert_array_equal(recording.landmark, landmark)
    np.testing.assert_array_equal(truth.association, landmark)
    np.testing.assert_array_equal(truth.landmark_ids, np.arange(37))


def test_nothing_is_seen_before_the_first_step_with_a_scan_and_all_else_stays() -> None:
    _, whole = simulate(scenario(), 0)
    _, late = simulate(scenario("sensor.first_step=3"), 0)
    kept = whole.observation_step >= 3
    assert not kept.all()
    np.testing.assert_array_equal(late.observation_step, whole.observation_step[kept])
    np.testing.assert_array_equal(late.observation, whole.observation[kept])
    np.testing.assert_array_equal(late.odometry, whole.odometry)


def test_a_map_without_landmarks():
    truth, recording = simulate(scenario("landmarks.positions=[]"), 0)
    assert given(truth.landmarks).shape == (0, 2)
    assert recording.observation.shape == (0, 2)


def test_close_landmarks_never_give_a_negative_range():
    _, recording = simulate(
        scenario("landmarks.positions=[[5, 0.1]]", "trajectory.yaw_rate=0", "trajectory.duration=10"), 0
    )
    assert recording.observation[:, 0].min() >= 0


# --- streams -----------------------------------------------------------------------------------


def test_a_seed_gives_the_same_run_and_another_seed_another():
    (truth, first), (again_truth, again) = simulate(scenario(), 7), simulate(scenario(), 7)
    np.testing.assert_array_equal(first.odometry, again.odometry)
    np.testing.assert_array_equal(first.observation, again.observation)
    np.testing.assert_array_equal(truth.poses, again_truth.poses)
    assert not np.array_equal(first.odometry, simulate(scenario(), 8)[1].odometry)


def test_the_map_and_the_start_do_not_change_the_odometry():
    _, dense = simulate(scenario("start=sampled"), 3)
    _, sparse = simulate(load_scenario("q1-long-sparse"), 3)
    np.testing.assert_array_equal(dense.odometry, sparse.odometry)


@pytest.mark.parametrize("overrides", [(), (POSITION,)])
def test_a_landmark_added_at_the_end_leaves_the_others_noise(overrides: tuple[str, ...]):
    small = scenario(*overrides)
    positions = [list(position) for position in small.landmarks.positions]
    _, before = simulate(small, 5)
    _, after = simulate(scenario(*overrides, f"landmarks.positions={[*positions, [1.0, 5.0]]}"), 5)
    old = given(after.landmark) < len(positions)
    assert not old.all()
    np.testing.assert_array_equal(after.observation[old], before.observation)


def test_a_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed: -1 is negative; use a whole number >= 0"):
        simulate(scenario(), -1)


# --- noise -------------------------------------------------------------------------------------


def test_odometry_noise_is_on_speed_and_yaw_rate_alone():
    _, recording = simulate(scenario(), 11)
    noise = recording.odometry - [0.1, 0.0, 0.01]
    np.testing.assert_array_equal(noise[:, 1], 0.0)
    assert_chi_square(noise[:, 0] / 0.03)
    assert_chi_square(noise[:, 2] / np.deg2rad(0.3))


@pytest.mark.parametrize(("overrides", "sigmas"), [((), [0.1, np.deg2rad(5)]), ((POSITION,), [0.2, 0.2])])
def test_sensor_noise_has_the_stated_size(overrides: tuple[str, ...], sigmas: list[float]):
    truth, recording = simulate(scenario(*overrides), 12)
    for component in (sensor_noise(truth, recording) / sigmas).T:
        assert_chi_square(component)
        assert_chi_square(np.array([component.mean() * np.sqrt(len(component))]))


def test_landmarks_have_independent_noise():
    truth, recording = simulate(scenario("sensor.max_range=1000"), 13)
    noise = sensor_noise(truth, recording)[:, 0].reshape(1258, 37) / 0.1
    correlation = np.asarray(np.corrcoef(noise, rowvar=False))[np.triu_indices(37, 1)]
    assert_chi_square(correlation * np.sqrt(1258))


def test_streams_are_independent_of_one_another():
    truth, recording = simulate(scenario("sensor.max_range=1000"), 14)
    motion = (recording.odometry[:, 0] - 0.1) / 0.03
    sensor = sensor_noise(truth, recording)[:, 0].reshape(1258, 37)[1:] / 0.1
    assert_chi_square(motion @ sensor / np.sqrt(np.sum(sensor**2, axis=0)))


def test_estimators_are_told_the_scaled_covariances():
    _, recording = simulate(scenario("assumed.motion_scale=10", "assumed.sensor_scale=0.1"), 0)
    _, plain = simulate(scenario(), 0)
    np.testing.assert_allclose(recording.odometry_cov[-1], np.diag([10 * 0.03**2, 0, 10 * np.deg2rad(0.3) ** 2]))
    np.testing.assert_allclose(recording.observation_cov[-1], np.diag([0.1 * 0.1**2, 0.1 * np.deg2rad(5) ** 2]))
    np.testing.assert_array_equal(recording.odometry, plain.odometry)
    np.testing.assert_array_equal(recording.observation, plain.observation)
    np.testing.assert_allclose(recording.prior_cov, np.diag([0.01, 0.01, 0.0001]))


def test_bearings_alone_point_at_the_landmarks():
    scenario = load_scenario("q4-ring", ["sensor.sigma_bearing_deg=0.001", "trajectory.duration=5"])
    truth, recording = simulate(scenario, 0)
    assert recording.sensor == "bearing"
    assert recording.observation.shape == (len(recording.observation_step), 1)
    np.testing.assert_allclose(recording.observation_cov, np.deg2rad(0.001) ** 2, rtol=1e-12)
    assert truth.poses is not None
    assert truth.landmarks is not None
    pose = truth.poses[recording.observation_step]
    offset = truth.landmarks[recording.landmark] - pose[:, :2]
    expected = np.arctan2(offset[:, 1], offset[:, 0]) - pose[:, 2]
    assert np.abs(wrap(recording.observation[:, 0] - expected)).max() < np.deg2rad(0.006)
    assert np.hypot(*offset.T).max() <= 10.0
