"""The simulator: exact truth on every kind of path, random maps, independent random streams, stated noise and errors.

Statistical tests use fixed seeds and two-sided bounds that a right simulator exceeds once in 10 000.
"""

from __future__ import annotations

import shutil
from pathlib import Path

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
from slamgauge.se2 import between, chain, in_body, rotation, wrap
from slamgauge.truth import NOBODY, Truth
from tests.reference.given import given

FALSE_ALARM_RATE = 1e-4  # probability that a right simulator fails a statistical test

POSITION = "sensor={kind='position', max_range=10, sigma_position=0.2}"


def run(*overrides: str, seed: int = 3) -> tuple[Truth, Recording]:
    return simulate(load_scenario("q1-short-dense", overrides), seed)


def scenario(*overrides: str) -> Scenario:
    return load_scenario("q1-long-dense", ["start=mean", *overrides])


def assert_chi_square(normalised: Float) -> None:
    """Assert that the sum of squares of supposed independent standard normal numbers is inside the bounds."""
    low, high = chi2.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], normalised.size)
    assert low < np.sum(normalised**2) < high


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


def test_a_map_without_landmarks():
    truth, recording = simulate(scenario("landmarks.positions=[]"), 0)
    assert given(truth.landmarks).shape == (0, 2)
    assert recording.observation.shape == (0, 2)


def test_noise_has_the_stated_size_and_no_mean():
    truth, recording = simulate(scenario(POSITION), 11)
    path, seen = given(truth.poses), recording.observation_step
    odometry = recording.odometry - between(path[:-1], path[1:])
    np.testing.assert_allclose(odometry[:, 1], 0.0, atol=1e-12)
    sensor = recording.observation - in_body(path[seen], given(truth.landmarks)[given(recording.landmark)])
    for noise in (odometry[:, 0] / 0.03, odometry[:, 2] / np.deg2rad(0.3), *(sensor / 0.2).T):
        assert_chi_square(noise)
        assert_chi_square(np.array([noise.mean() * np.sqrt(len(noise))]))


def test_estimators_receive_the_scaled_covariances():
    """`tests/test_questions.py` shows that measurements do not change."""
    _, recording = simulate(scenario("assumed.motion_scale=10", "assumed.sensor_scale=0.1"), 0)
    np.testing.assert_allclose(recording.odometry_cov[-1], np.diag([10 * 0.03**2, 0, 10 * np.deg2rad(0.3) ** 2]))
    np.testing.assert_allclose(recording.observation_cov[-1], np.diag([0.1 * 0.1**2, 0.1 * np.deg2rad(5) ** 2]))
    np.testing.assert_allclose(recording.prior_cov, np.diag([0.01, 0.01, 0.0001]))


def before(scenario: Scenario, seed: int) -> tuple[Float, Float, Float, list[Int]]:
    """Return path, odometry, observations, and their steps and landmarks, simulated without options.

    Start, motion and each landmark have a random stream of their own, so that none changes the draws of another.
    """
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


NAMES = [name for name, _ in shipped_scenarios()]
NEAR = ("sensor.min_range=3", "sensor.max_range=7", "sensor.first_step=3")


@pytest.mark.parametrize(
    ("name", "overrides"),
    [*((name, (f"start={start}",)) for name in NAMES for start in ("mean", "sampled")), ("q1-long-dense", NEAR)],
)
def test_scenarios_simulate_the_same_as_without_options(name: str, overrides: tuple[str, ...]) -> None:
    scenario = load_scenario(name, overrides)
    truth, recording = simulate(scenario, 7)
    poses, odometry, observation, seen = before(scenario, 7)
    np.testing.assert_array_equal(truth.poses, np.c_[poses[:, :2], wrap(poses[:, 2])])
    np.testing.assert_array_equal(recording.odometry, odometry)
    np.testing.assert_array_equal(recording.observation, observation)
    np.testing.assert_array_equal([recording.observation_step, truth.association], seen)
    assert truth.outlier is None


def test_the_noise_of_the_octave_course() -> None:
    """Covariances as the exercise states them."""
    _, recording = simulate(load_scenario("freiburg-course", ["trajectory.duration=2"]), 5)
    np.testing.assert_allclose(recording.odometry_cov, np.tile(np.diag([0.1, 0.1, 0.01]), (2, 1, 1)), rtol=1e-12)
    np.testing.assert_allclose(recording.observation_cov[0], 0.01 * np.eye(2), rtol=1e-12)


def moved(trajectory: str, *overrides: str) -> tuple[Float, Recording]:
    truth, recording = run("start=mean", f"trajectory={trajectory}", *overrides)
    return given(truth.poses), recording


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
    np.testing.assert_allclose(given(truth.poses), [[1, 2, 3], [1.5, 2, -3], [2, 2.5, -2]], atol=1e-12)
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
    landmarks = given(one.landmarks)
    apart = np.linalg.norm(landmarks[:, None] - landmarks, axis=2)[np.triu_indices(40, 1)]
    assert apart.min() >= 1.0
    assert (landmarks >= [-5, 0]).all()
    assert (landmarks <= [5, 20]).all()
    np.testing.assert_array_equal(given(run(chosen.replace("40", "41"))[0].landmarks)[:40], landmarks)


# --- errors of measurements that no estimator receives: none of them changes other draws -----------

OUTLIERS = ("sensor.outlier_rate=0.1",)
CLUTTER = ("sensor.clutter_rate=0.5",)


@pytest.mark.parametrize(
    "option", [*OUTLIERS, "sensor.outlier_rate=1", *CLUTTER, "sensor.detection_probability=0.5", "motion.slip_rate=0.2"]
)
def test_an_option_changes_no_other_draws(option: str) -> None:
    plain_truth, plain = run("start=sampled")
    truth, recording = run("start=sampled", option)
    np.testing.assert_array_equal(truth.poses, plain_truth.poses)
    sound = np.flatnonzero(~truth.misleading) if truth.misleading is not None else np.arange(0)
    rows = {
        key: row for row, key in enumerate(zip(plain.observation_step, given(plain_truth.association), strict=True))
    }
    same = [rows[recording.observation_step[i], given(truth.association)[i]] for i in sound]
    np.testing.assert_array_equal(recording.observation[sound], plain.observation[same])
    if not option.startswith("motion"):
        np.testing.assert_array_equal(recording.odometry, plain.odometry)
        assert recording != plain


def test_a_higher_rate_keeps_the_outliers_of_a_lower_rate() -> None:
    few, many = (given(run(f"sensor.outlier_rate={rate}")[0].outlier) for rate in (0.02, 0.1))
    assert many[few].all()
    assert 0 < few.sum() < many.sum()


def assert_count(count: int, trials: int, probability: float) -> None:
    low, high = binom.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], trials, probability)
    assert low <= count <= high


def test_outliers_have_the_stated_rate_and_are_uniform() -> None:
    truth, recording = run(*OUTLIERS, "sensor.field_of_view_deg=180", "sensor.min_range=1")
    outlier = given(truth.outlier)
    assert_count(int(outlier.sum()), len(outlier), 0.1)
    ranges, bearings = recording.observation[outlier].T
    assert 1.0 <= ranges.min() < 2.0 < 9.0 < ranges.max() <= 10.0
    assert_count(int((bearings > 0).sum()), len(bearings), 0.5)
    assert 1.4 < np.abs(bearings).max() <= np.pi / 2


def test_wide_outliers_have_ten_times_the_noise() -> None:
    truth, recording = run("sensor.outlier_rate=1", "sensor.outlier=wide", "sensor.min_range=5")
    offsets = given(truth.landmarks)[truth.association] - given(truth.poses)[recording.observation_step, :2]
    noise = (recording.observation[:, 0] - np.hypot(*offsets.T)) / 1.0
    assert abs(noise.std() - 1.0) < 3.9 / np.sqrt(2 * len(noise))


def test_clutter_is_of_no_landmark_and_has_new_ids() -> None:
    truth, recording = run(*CLUTTER, "sensor.first_step=10")
    association, ids = given(truth.association), given(recording.landmark)
    clutter = association == NOBODY
    mean = 0.5 * (recording.steps + 1 - 10)
    low, high = poisson.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], mean)
    assert low <= clutter.sum() <= high
    assert recording.observation_step.min() >= 10
    assert not np.isin(ids[clutter], given(truth.landmark_ids)).any()
    assert len(np.unique(ids[clutter])) == clutter.sum()
    np.testing.assert_array_equal(ids[~clutter], association[~clutter])
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
    for name, overrides in (("with", OUTLIERS), ("without", ())):
        truth, _ = run(*overrides)
        save(tmp_path / f"{name}.npz", truth)
        assert load_truth(tmp_path / f"{name}.npz") == truth
        with np.load(tmp_path / f"{name}.npz") as file:
            assert ("outlier" in file.files) == (name == "with")
