"""What can be wrong in a scenario beside noise, and the paths and maps that it can have.

Statistical tests use fixed seeds and two-sided bounds that a right simulator misses once in 10 000.
"""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, poisson

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.scenario import Scenario, ScenarioError, load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.compare.storage.files import load_truth, save
from slamgauge.compare.studies.store import digest
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.truth import NOBODY, Truth

FALSE_ALARM_RATE = 1e-4
OUTLIERS = ("sensor.outlier_rate=0.1",)
CLUTTER = ("sensor.clutter_rate=0.5",)


def run(*overrides: str, name: str = "q1-short-dense", seed: int = 3) -> tuple[Truth, Recording]:
    return simulate(load_scenario(name, overrides), seed)


def before(scenario: Scenario, seed: int) -> tuple[Float, Float, Float, list[Int]]:
    """Path, odometry, observations, and their steps and landmarks, as simulated before there were options."""
    start, motion, sensor = np.random.SeedSequence(seed).spawn(3)
    assert isinstance(scenario.trajectory, Segments)
    dt, mean = scenario.trajectory.step, np.array(scenario.prior.mean)
    rates = [(segment.speed, 0.0, segment.yaw_rate) for segment in scenario.trajectory.segments]
    command = np.repeat(np.array(rates) * dt, scenario.trajectory.steps, axis=0)
    if scenario.start == "sampled":
        mean = mean + np.sqrt(scenario.prior.variances) * np.random.default_rng(start).standard_normal(3)
    assert scenario.motion.sigma_speed is not None
    assert scenario.motion.sigma_yaw_rate_deg is not None
    sigma = dt * np.array([scenario.motion.sigma_speed, 0.0, np.deg2rad(scenario.motion.sigma_yaw_rate_deg)])
    odometry = command + sigma * np.random.default_rng(motion).standard_normal(command.shape)

    poses, landmarks, sees = chain(mean, command), np.array(scenario.landmarks.positions), scenario.sensor
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
def test_shipped_scenarios_simulate_what_they_did_before_there_were_options(name: str, start: str) -> None:
    scenario = load_scenario(name, [f"start={start}"])
    truth, recording = simulate(scenario, 7)
    poses, odometry, observation, seen = before(scenario, 7)
    np.testing.assert_array_equal(truth.poses, np.c_[poses[:, :2], wrap(poses[:, 2])])
    np.testing.assert_array_equal(recording.odometry, odometry)
    np.testing.assert_array_equal(recording.observation, observation)
    np.testing.assert_array_equal([recording.observation_step, truth.association], seen)
    assert truth.outlier is None


# --- common random numbers ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "option", [*OUTLIERS, "sensor.outlier_rate=1", *CLUTTER, "sensor.detection_probability=0.5", "motion.slip_rate=0.2"]
)
def test_an_option_leaves_all_other_draws_as_they_were(option: str) -> None:
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


def test_outliers_stay_where_they_were_when_there_are_more() -> None:
    few, many = run("sensor.outlier_rate=0.02")[0].outlier, run("sensor.outlier_rate=0.1")[0].outlier
    assert few is not None
    assert many is not None
    assert many[few].all()
    assert 0 < few.sum() < many.sum()


# --- what is wrong -----------------------------------------------------------------------------


def assert_count(count: int, trials: int, probability: float) -> None:
    low, high = binom.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], trials, probability)
    assert low <= count <= high


def test_outliers_are_as_many_as_stated_and_anywhere() -> None:
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


def test_clutter_is_of_nobody_and_has_ids_of_its_own() -> None:
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


def test_what_is_behind_or_missed_is_not_seen() -> None:
    truth, recording = run("sensor.field_of_view_deg=120", "sensor.sigma_bearing_deg=0.01")
    assert 1.0 < np.abs(recording.observation[:, 1]).max() < np.deg2rad(60.1)
    some = len(run("sensor.detection_probability=0.3")[1].observation)
    assert_count(some, len(run()[1].observation), 0.3)
    assert truth.outlier is None


def test_odometry_misreads_as_it_is_told_to() -> None:
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


def test_a_truth_with_outliers_survives_a_file_and_an_old_file_has_none(tmp_path: Path) -> None:
    for overrides in (OUTLIERS, ()):
        truth, _ = run(*overrides)
        save(tmp_path / "truth.npz", truth)
        assert load_truth(tmp_path / "truth.npz") == truth
    with np.load(tmp_path / "truth.npz") as file:
        assert {*file.files} == {field.name for field in fields(Truth)} - {"outlier"}


# --- paths and maps ----------------------------------------------------------------------------


def moved(trajectory: str, *overrides: str) -> tuple[Float, Recording]:
    truth, recording = run(f"trajectory={trajectory}", *overrides)
    assert truth.poses is not None
    return truth.poses, recording


def test_waypoints_are_met_exactly_and_speeds_are_kept() -> None:
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


def test_a_figure_of_eight_comes_back_twice() -> None:
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
    scenario = load_scenario(tmp_path / "my.toml")
    truth, recording = simulate(scenario, 0)
    assert truth.poses is not None
    np.testing.assert_allclose(truth.poses, [[1, 2, 3], [1.5, 2, -3], [2, 2.5, -2]], atol=1e-12)
    np.testing.assert_array_equal(recording.stamps, [5, 5.5, 6.5])
    np.testing.assert_allclose(np.sqrt(recording.odometry_cov[:, 0, 0]), [0.15, 0.3])
    assert scenario.trajectory.step == 0.75

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tmp_path, elsewhere, ignore=shutil.ignore_patterns("elsewhere"))
    assert load_scenario(elsewhere / "my.toml") == scenario
    assert digest(load_scenario(elsewhere / "my.toml"), 0) == digest(scenario, 0)
    (elsewhere / "path.csv").write_text("stamp,x,y,theta\n5,1,2,3\n5.5,1.5,2,-3\n6.5,2,2.5,-2.1\n")
    assert digest(load_scenario(elsewhere / "my.toml"), 0) != digest(scenario, 0)


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


# --- mistakes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("trajectory={kind='spiral', step=1}", "trajectory: kind is not known; use one of segments, waypoints,"),
        ("trajectory.radius=3", "trajectory.radius: a trajectory of the kind segments has none; remove it or"),
        ("trajectory={kind='waypoints', step=1, points=[], speed=1, yaw_rate=1}", "trajectory.points: must have at"),
        ("trajectory={kind='figure-eight', step=1, radius=-1, speed=1}", "trajectory.radius: must be greater than 0"),
        ("trajectory={kind='csv', file='none.csv'}", "trajectory.file: none.csv: cannot be read (No such file"),
        ("sensor.field_of_view_deg=0", "sensor.field_of_view_deg: must be greater than 0, not 0"),
        ("sensor.outlier_rate=1.2", "sensor.outlier_rate: must be less than or equal to 1, not 1.2"),
        ("sensor.outlier=cauchy", "sensor.outlier: must be 'uniform' or 'wide', not 'cauchy'"),
        ("motion.slip_rat=1", "motion.slip_rat: unknown key; did you mean slip_rate?"),
        ("prior.covariance=[[1,0,0],[0,-1,0],[0,0,1]]", "prior.covariance: covariance[0] = "),
        ("landmarks.random={count=3, box=[0,0,1,1]}", "landmarks: has both forms; give positions, or random"),
        ("landmarks={}", "landmarks: has no landmarks; give positions ([] for none), or random"),
        ("landmarks={random={count=9, box=[0,0,1,0]}}", "landmarks.random: box is empty; give [x from, y from,"),
        (
            "landmarks={random={count=9, box=[0,0,1,1], min_distance=1}}",
            "landmarks.random: only 1 of 9 landmarks fit at min_distance = 1.0; lower it or enlarge the box",
        ),
    ],
)
def test_mistakes_are_a_line_each(override: str, line: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("q1-short-dense", [override])
    (told,) = str(caught.value).splitlines()
    assert told.startswith(f"q1-short-dense: {line}")


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("stamp,x,y\n1,2,3\n", "path.csv: line 1 is not the header of this file; write stamp,x,y,theta"),
        ("stamp,x,y,theta\n0,0,0,0\n", "path.csv: 1 poses; give 2 to 1000001"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,nan\n", "path.csv, line 3: '1,1,0,nan'; write 4 finite numbers"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,0\n1,2,0,0\n", "path.csv, line 4: stamps must increase; sort the rows"),
        ("stamp,x,y,theta\n0,1,0,0\n1,1,0,0\n", "prior.mean: [0.0, 0.0, 0.0] is not where the path of path.csv"),
    ],
)
def test_files_of_a_scenario_are_told_by_their_line(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / "path.csv").write_text(path)
    (tmp_path / "my.toml").write_text("extends = 'q1-short-dense'\ntrajectory = {kind = 'csv', file = 'path.csv'}\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / "my.toml")
    (told,) = str(caught.value).splitlines()
    assert line in told
