"""The simulator: exact truth, independent random streams, stated noise and errors, all kinds of paths and maps.

Statistical tests use fixed seeds and two-sided bounds that a right simulator exceeds once in 10 000.
"""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from scipy.stats import binom, chi2, poisson

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.compare.storage.files import load_truth, save
from slamgauge.compare.studies.store import digest
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, rotation, wrap
from slamgauge.truth import NOBODY, Truth

T = TypeVar("T")

FALSE_ALARM_RATE = 1e-4
POSITION = "sensor={kind='position', max_range=10, sigma_position=0.2}"


def scenario(*overrides: str) -> Scenario:
    return load_scenario("q1-long-dense", ["start=mean", *overrides])


def given(field: T | None) -> T:
    assert field is not None
    return field


def assert_chi_square(normalised: Float) -> None:
    """Assert that the sum of squares of supposed independent standard normal numbers is inside the bounds."""
    low, high = chi2.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], normalised.size)
    assert low < np.sum(normalised**2) < high


def true_body(truth: Truth, recording: Recording) -> Float:
    """Return the observed landmarks (M, 2) in the body frames of the true poses."""
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


def test_all_landmarks_in_range_are_observed_from_step_zero_on():
    truth, recording = simulate(scenario("sensor.min_range=3", "sensor.max_range=7"), 0)
    distance = np.linalg.norm(given(truth.poses)[:, None, :2] - given(truth.landmarks), axis=2)
    step, landmark = np.nonzero((distance >= 3) & (distance <= 7))
    assert step[0] == 0
    np.testing.assert_array_equal(recording.observation_step, step)
    np.testing.assert_array_equal(recording.landmark, landmark)
    np.testing.assert_array_equal(truth.association, landmark)
    np.testing.assert_array_equal(truth.landmark_ids, np.arange(37))


def test_first_step_only_removes_earlier_scans() -> None:
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
    close = scenario("landmarks.positions=[[5, 0.1]]", "trajectory.yaw_rate=0", "trajectory.duration=10")
    _, recording = simulate(close, 0)
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
    _, sparse = simulate(load_scenario("q1-long-sparse", ["start=mean"]), 3)
    np.testing.assert_array_equal(dense.odometry, sparse.odometry)


@pytest.mark.parametrize("overrides", [(), (POSITION,)])
def test_an_added_landmark_does_not_change_the_noise_of_the_others(overrides: tuple[str, ...]):
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


def test_odometry_noise_is_on_speed_and_yaw_rate_only():
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


def test_estimators_receive_the_scaled_covariances():
    _, recording = simulate(scenario("assumed.motion_scale=10", "assumed.sensor_scale=0.1"), 0)
    _, plain = simulate(scenario(), 0)
    np.testing.assert_allclose(recording.odometry_cov[-1], np.diag([10 * 0.03**2, 0, 10 * np.deg2rad(0.3) ** 2]))
    np.testing.assert_allclose(recording.observation_cov[-1], np.diag([0.1 * 0.1**2, 0.1 * np.deg2rad(5) ** 2]))
    np.testing.assert_array_equal(recording.odometry, plain.odometry)
    np.testing.assert_array_equal(recording.observation, plain.observation)
    np.testing.assert_allclose(recording.prior_cov, np.diag([0.01, 0.01, 0.0001]))


def test_bearings_point_at_the_landmarks():
    scenario = load_scenario("q4-ring", ["sensor.sigma_bearing_deg=0.001", "trajectory.duration=5"])
    truth, recording = simulate(scenario, 0)
    assert recording.sensor == "bearing"
    assert recording.observation.shape == (len(recording.observation_step), 1)
    np.testing.assert_allclose(recording.observation_cov, np.deg2rad(0.001) ** 2, rtol=1e-12)
    np.testing.assert_array_equal(recording.landmark, truth.association)
    body = true_body(truth, recording)
    expected = np.arctan2(body[:, 1], body[:, 0])
    assert np.abs(wrap(recording.observation[:, 0] - expected)).max() < np.deg2rad(0.006)
    assert np.hypot(*body.T).max() <= 10.0


OUTLIERS = ("sensor.outlier_rate=0.1",)
CLUTTER = ("sensor.clutter_rate=0.5",)


def run(*overrides: str, name: str = "q1-short-dense", seed: int = 3) -> tuple[Truth, Recording]:
    return simulate(load_scenario(name, overrides), seed)


def before(scenario: Scenario, seed: int) -> tuple[Float, Float, Float, list[Int]]:
    """Return path, odometry, observations, and their steps and landmarks, simulated without options."""
    start, motion, sensor = np.random.SeedSequence(seed).spawn(3)
    assert isinstance(scenario.trajectory, Segments)
    dt, mean = scenario.trajectory.step, np.array(scenario.prior.mean)
    rates = [(segment.speed, 0.0, segment.yaw_rate) for segment in scenario.trajectory.segments]
    command = np.repeat(np.array(rates) * dt, scenario.trajectory.steps, axis=0)
    if scenario.start == "sampled":
        mean = mean + np.sqrt(scenario.prior.variances) * np.random.default_rng(start).standard_normal(3)
    assert scenario.motion.sigma_speed is not None
    assert scenario.motion.sigma_yaw_rate_deg is not None
    lateral = scenario.motion.sigma_lateral or 0.0
    sigma = dt * np.array([scenario.motion.sigma_speed, lateral, np.deg2rad(scenario.motion.sigma_yaw_rate_deg)])
    odometry = command + sigma * np.random.default_rng(motion).standard_normal(command.shape)

    poses, landmarks, sees = chain(mean, command), scenario.landmarks.all(), scenario.sensor
    body = np.einsum("nji,nlj->nli", rotation(poses[:, 2]), landmarks - poses[:, None, :2])
    distance = np.linalg.norm(body, axis=2)
    in_view = (sees.min_range <= distance) & (distance <= sees.max_range)
    in_view[: sees.first_step] = False
    seen_at, seen = np.nonzero(in_view)
    noise = np.empty((len(poses), len(landmarks), len(sees.sigmas)))
    for landmark, child in enumerate(sensor.spawn(len(landmarks))):
        noise[:, landmark] = sees.sigmas * np.random.default_rng(child).standard_normal((len(poses), len(sees.sigmas)))
    noise, body = noise[seen_at, seen], body[seen_at, seen]
    bearings = wrap(np.arctan2(body[:, 1], body[:, 0]) + noise[:, -1])
    ranges = np.abs(distance[seen_at, seen] + noise[:, 0])
    values = {"position": body + noise, "bearing": bearings[:, None], "range-bearing": np.c_[ranges, bearings]}
    return poses, odometry, values[sees.kind], [seen_at, seen]


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios()])
@pytest.mark.parametrize("start", ["mean", "sampled"])
def test_shipped_scenarios_simulate_the_same_as_without_options(name: str, start: str) -> None:
    scenario = load_scenario(name, [f"start={start}"])
    truth, recording = simulate(scenario, 7)
    poses, odometry, observation, seen = before(scenario, 7)
    np.testing.assert_array_equal(truth.poses, np.c_[poses[:, :2], wrap(poses[:, 2])])
    np.testing.assert_array_equal(recording.odometry, odometry)
    np.testing.assert_array_equal(recording.observation, observation)
    np.testing.assert_array_equal([recording.observation_step, truth.association], seen)
    assert truth.outlier is None


def test_the_noise_of_the_octave_course() -> None:
    """Covariances as the exercise states them; the drawn noise has them, in each axis (false-alarm rate 3e-4)."""
    truth, recording = simulate(load_scenario("freiburg-course", ["trajectory.duration=2000"]), 5)
    stated = np.diag([0.1, 0.1, 0.01])
    np.testing.assert_allclose(recording.odometry_cov, np.tile(stated, (2000, 1, 1)), rtol=1e-12)
    np.testing.assert_allclose(recording.observation_cov[0], 0.01 * np.eye(2), rtol=1e-12)
    assert truth.poses is not None
    white = (recording.odometry - between(truth.poses[:-1], truth.poses[1:])) / np.sqrt(np.diag(stated))
    assert np.abs((white**2).mean(axis=0) - 1.0).max() < 3.9 * np.sqrt(2 / 2000)


# --- common random numbers ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "option", [*OUTLIERS, "sensor.outlier_rate=1", *CLUTTER, "sensor.detection_probability=0.5", "motion.slip_rate=0.2"]
)
def test_an_option_changes_no_other_draws(option: str) -> None:
    plain_truth, plain = run("start=sampled")
    truth, recording = run("start=sampled", option)
    np.testing.assert_array_equal(truth.poses, plain_truth.poses)
    assert truth.association is not None
    assert plain_truth.association is not None
    sound = np.flatnonzero(~truth.misleading) if truth.misleading is not None else np.arange(0)
    known = {
        key: row
        for row, key in enumerate(zip(plain.observation_step.tolist(), plain_truth.association.tolist(), strict=True))
    }
    same = [known[int(recording.observation_step[i]), int(truth.association[i])] for i in sound]
    np.testing.assert_array_equal(recording.observation[sound], plain.observation[same])
    if not option.startswith("motion"):
        np.testing.assert_array_equal(recording.odometry, plain.odometry)
        assert recording != plain


def test_a_higher_rate_keeps_the_outliers_of_a_lower_rate() -> None:
    few, many = run("sensor.outlier_rate=0.02")[0].outlier, run("sensor.outlier_rate=0.1")[0].outlier
    assert few is not None
    assert many is not None
    assert many[few].all()
    assert 0 < few.sum() < many.sum()


# --- errors ------------------------------------------------------------------------------------


def assert_count(count: int, trials: int, probability: float) -> None:
    low, high = binom.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], trials, probability)
    assert low <= count <= high


def test_outliers_have_the_stated_rate_and_are_uniform() -> None:
    truth, recording = run(*OUTLIERS, "sensor.field_of_view_deg=180", "sensor.min_range=1")
    assert truth.outlier is not None
    assert_count(int(truth.outlier.sum()), len(truth.outlier), 0.1)
    ranges, bearings = recording.observation[truth.outlier].T
    assert 1.0 <= ranges.min() < 2.0 < 9.0 < ranges.max() <= 10.0
    assert_count(int((bearings > 0).sum()), len(bearings), 0.5)
    assert 1.4 < np.abs(bearings).max() <= np.pi / 2


def test_wide_outliers_have_ten_times_the_noise() -> None:
    truth, recording = run("sensor.outlier_rate=1", "sensor.outlier=wide", "sensor.min_range=5")
    assert truth.poses is not None
    assert truth.landmarks is not None
    offsets = truth.landmarks[truth.association] - truth.poses[recording.observation_step, :2]
    noise = (recording.observation[:, 0] - np.hypot(*offsets.T)) / 1.0
    assert abs(noise.std() - 1.0) < 3.9 / np.sqrt(2 * len(noise))


def test_clutter_is_of_no_landmark_and_has_new_ids() -> None:
    truth, recording = run(*CLUTTER, "sensor.first_step=10")
    assert truth.association is not None
    assert truth.landmark_ids is not None
    clutter = truth.association == NOBODY
    mean = 0.5 * (recording.steps + 1 - 10)
    low, high = poisson.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], mean)
    assert low <= clutter.sum() <= high
    assert recording.observation_step.min() >= 10
    assert recording.landmark is not None
    assert not np.isin(recording.landmark[clutter], truth.landmark_ids).any()
    assert len(np.unique(recording.landmark[clutter])) == clutter.sum()
    np.testing.assert_array_equal(recording.landmark[~clutter], truth.association[~clutter])
    assert recording.observation[clutter, 0].max() <= 10.0


def test_field_of_view_and_detection_probability() -> None:
    truth, recording = run("sensor.field_of_view_deg=120", "sensor.sigma_bearing_deg=0.01")
    assert 1.0 < np.abs(recording.observation[:, 1]).max() < np.deg2rad(60.1)
    some = len(run("sensor.detection_probability=0.3")[1].observation)
    assert_count(some, len(run()[1].observation), 0.3)
    assert truth.outlier is None


def test_odometry_has_the_stated_errors() -> None:
    plain = run()[1].odometry
    longer = run("motion.scale_error=0.02")[1].odometry
    np.testing.assert_allclose(longer - plain, np.tile([0.002, 0.0, 0.0], (len(plain), 1)), atol=1e-15)
    turned = run("motion.turn_bias_per_metre=-0.1")[1].odometry
    np.testing.assert_allclose(turned - plain, np.tile([0.0, 0.0, -0.01], (len(plain), 1)), atol=1e-15)
    slipped = run("motion.slip_rate=0.2")[1].odometry - plain
    slips = slipped[:, 0] > 1e-12
    assert_count(int(slips.sum()), len(slips), 0.2)
    assert slipped[:, 0].max() <= 0.1 + 1e-12
    np.testing.assert_array_equal(slipped[~slips][:, 0].round(12), 0.0)
    np.testing.assert_allclose(slipped[:, 1:], 0.0, atol=1e-15)


def test_outliers_of_a_truth_are_stored_if_it_has_them(tmp_path: Path) -> None:
    for overrides in (OUTLIERS, ()):
        truth, _ = run(*overrides)
        save(tmp_path / "truth.npz", truth)
        assert load_truth(tmp_path / "truth.npz") == truth
    with np.load(tmp_path / "truth.npz") as file:
        assert {*file.files} == {field.name for field in fields(Truth)} - {"outlier"}


# --- paths and maps ----------------------------------------------------------------------------


def moved(trajectory: str, *overrides: str) -> tuple[Float, Recording]:
    truth, recording = run("start=mean", f"trajectory={trajectory}", *overrides)
    assert truth.poses is not None
    return truth.poses, recording


def test_waypoints_are_reached_exactly_and_speeds_are_limited() -> None:
    points = "[[2.03, 0], [2.03, 0], [2, 1], [0, 0]]"
    path, recording = moved(
        f"{{kind='waypoints', step=0.1, points={points}, speed=0.5, yaw_rate=1}}", "prior.mean=[0, 0, 0.3]"
    )
    for point in ([2.03, 0.0], [2.0, 1.0], [0.0, 0.0]):
        assert np.linalg.norm(path[:, :2] - point, axis=1).min() < 1e-12
    steps = np.diff(path, axis=0)
    assert 0.045 < np.linalg.norm(steps[:, :2], axis=1).max() <= 0.05 + 1e-12
    assert 0.09 < np.abs(wrap(steps[:, 2])).max() <= 0.1 + 1e-12
    np.testing.assert_allclose(recording.stamps, 0.1 * np.arange(len(path)), atol=1e-12)


def test_a_figure_eight_returns_to_the_start_twice_per_lap() -> None:
    path, _ = moved("{kind='figure-eight', step=0.1, radius=3, speed=1, laps=2}")
    np.testing.assert_allclose(path[-1], 0.0, atol=1e-12)
    back = np.flatnonzero(np.linalg.norm(path[:, :2], axis=1) < 1e-9)
    assert len(back) == 5
    assert (path[:, 1].max(), path[:, 1].min()) == pytest.approx((6.0, -6.0), abs=0.01)


def test_a_path_of_a_file_keeps_its_poses_and_stamps(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_text("stamp,x,y,theta\n5,1,2,3\n5.5,1.5,2,-3\n6.5,2,2.5,-2\n")
    (tmp_path / "my.toml").write_text(
        "extends = 'q1-short-dense'\nprior = {mean = [1, 2, 3]}\n[trajectory]\nkind = 'csv'\nfile = 'path.csv'\n"
    )
    scenario = load_scenario(tmp_path / "my.toml", ["start=mean"])
    truth, recording = simulate(scenario, 0)
    assert truth.poses is not None
    np.testing.assert_allclose(truth.poses, [[1, 2, 3], [1.5, 2, -3], [2, 2.5, -2]], atol=1e-12)
    np.testing.assert_array_equal(recording.stamps, [5, 5.5, 6.5])
    np.testing.assert_allclose(np.sqrt(recording.odometry_cov[:, 0, 0]), [0.15, 0.3])
    assert scenario.trajectory.step == 0.75

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tmp_path, elsewhere, ignore=shutil.ignore_patterns("elsewhere"))
    assert load_scenario(elsewhere / "my.toml", ["start=mean"]) == scenario
    assert digest(load_scenario(elsewhere / "my.toml", ["start=mean"]), 0) == digest(scenario, 0)
    (elsewhere / "path.csv").write_text("stamp,x,y,theta\n5,1,2,3\n5.5,1.5,2,-3\n6.5,2,2.5,-2.1\n")
    assert digest(load_scenario(elsewhere / "my.toml", ["start=mean"]), 0) != digest(scenario, 0)


def test_random_landmarks_are_the_same_map_in_every_run() -> None:
    chosen = "landmarks={random={count=40, box=[-5, 0, 5, 20], seed=4, min_distance=1}}"
    (one, _), (other, _) = run(chosen), run(chosen, seed=9)
    np.testing.assert_array_equal(one.landmarks, other.landmarks)
    assert one.landmarks is not None
    apart = np.linalg.norm(one.landmarks[:, None] - one.landmarks, axis=2)[np.triu_indices(40, 1)]
    assert apart.min() >= 1.0
    assert (one.landmarks >= [-5, 0]).all()
    assert (one.landmarks <= [5, 20]).all()
    more = run(chosen.replace("40", "41"))[0].landmarks
    assert more is not None
    np.testing.assert_array_equal(more[:40], one.landmarks)
