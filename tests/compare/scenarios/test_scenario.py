"""Scenario files: meaning, overrides, extended scenarios, mistakes, and the constants and maps of the shipped ones."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import Scenario, load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.ekf.settings import Delayed, Rays
from slamgauge.errors import UserError
from tests.reference.given import given

Write = Callable[[str], str]

GOOD = """
description = "a square's first side, and a turn"
[trajectory]
step = 0.1
segments = [{speed = 1.0, yaw_rate = 0.0, duration = 2.0}, {speed = 0.0, yaw_rate = 1.5, duration = 1.04}]
[motion]
sigma_speed = 0.1
sigma_yaw_rate_deg = 1
[sensor]
kind = "position"
max_range = 5
sigma_position = 0.2
[landmarks]
positions = [[1, 2], [3.5, -1]]
"""


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> str:
        path = tmp_path / "my.toml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


def segmented(scenario: Scenario) -> Segments:
    assert isinstance(scenario.trajectory, Segments)
    return scenario.trajectory


def test_file_with_segments_and_defaults(write: Write):
    scenario = load_scenario(write(GOOD))
    assert scenario.name == "my"
    assert scenario.start == "sampled"
    assert scenario.prior.variances == (0.01, 0.01, 0.0001)
    assert scenario.assumed.motion_scale == scenario.assumed.sensor_scale == 1.0
    assert segmented(scenario).steps == (20, 10)
    assert scenario.landmarks.positions == ((1.0, 2.0), (3.5, -1.0))
    np.testing.assert_array_equal(scenario.sensor.sigmas, [0.2, 0.2])


def test_a_single_segment_a_short_segment_and_degrees(write: Write):
    scenario = load_scenario("q1-long-dense")
    assert [segment.yaw_rate for segment in segmented(scenario).segments] == [0.1]
    assert segmented(scenario).steps == (1257,)
    assert segmented(load_scenario(write(GOOD.replace("1.04", "0.01")))).steps == (20, 1)
    np.testing.assert_allclose(scenario.sensor.sigmas, [0.1, np.deg2rad(5.0)], rtol=1e-15)


def test_durations_between_whole_steps_are_rounded_with_a_notice(capsys: pytest.CaptureFixture[str]):
    for name, _ in shipped_scenarios():
        load_scenario(name)
    assert not capsys.readouterr().err
    load_scenario("q1-long-dense", ["trajectory.step=100", "trajectory.duration=3", "motion.sigma_speed=0.1"])
    load_scenario("q1-long-dense", ["trajectory.duration=3.04"])
    told = [line for line in capsys.readouterr().err.splitlines() if line]
    assert told == [
        "slamgauge: trajectory: the duration of 3 s is rounded to whole steps, 1 x 100 s = 100 s",
        "slamgauge: trajectory: the duration of 3.04 s is rounded to whole steps, 30 x 0.1 s = 3 s",
    ]


@pytest.mark.parametrize("name", ["q1-short-dense", "q4-ring"])
def test_scenarios_are_immutable_and_survive_a_dump(name: str):
    scenario = load_scenario(name)
    assert type(scenario).model_validate(scenario.model_dump()) == pickle.loads(pickle.dumps(scenario)) == scenario
    with pytest.raises(ValueError, match="frozen"):
        setattr(scenario, "start", "sampled")  # noqa: B010 type checkers refuse an assignment


def test_overrides_are_toml_values_or_strings_and_may_begin_or_replace_a_section():
    overrides = ["start=sampled", "trajectory.yaw_rate = -0.2", "prior.variances=[0, 0, 0]", "assumed.motion_scale=2"]
    overrides += ["description=an east-west run", "sensor={kind='position', max_range=10, sigma_position=0.2}"]
    scenario = load_scenario("q1-long-sparse", overrides)
    assert scenario.start == "sampled"
    assert segmented(scenario).segments[0].yaw_rate == -0.2
    assert scenario.prior.variances == (0.0, 0.0, 0.0)
    assert scenario.description == "an east-west run"
    assert scenario.assumed.motion_scale == 2.0
    assert scenario.sensor.sigma_range is None


def test_overrides_replace_landmarks_by_random_ones_and_back():
    fixed, drawn = "landmarks.positions=[[1, 2]]", "landmarks.random={count=7, box=[-5, -5, 13, 13], seed=1}"
    assert given(load_scenario("q1-long-dense", [fixed, drawn]).landmarks.random).count == 7
    assert load_scenario("q1-long-dense", [drawn, fixed]).landmarks.positions == ((1.0, 2.0),)


def test_a_file_may_extend_a_shipped_scenario_by_keys_and_by_sections_of_another_form(write: Write):
    text = """extends = "q2-long-dense"
description = "mine"
[association]
gate = 4
[trajectory]
step = 0.5
segments = [{speed = 1.0, yaw_rate = 0.0, duration = 2.0}]
[sensor]
kind = "position"
max_range = 5.0
sigma_position = 0.1
"""
    mine, base = load_scenario(write(text)), load_scenario("q2-long-dense")
    assert (mine.name, mine.description) == ("my", "mine")
    assert (mine.association.method, mine.association.gate) == ("nearest-neighbour", 4.0)
    assert segmented(mine).steps == (4,)
    assert (mine.sensor.kind, mine.sensor.sigma_range) == ("position", None)
    assert (mine.landmarks, mine.prior, mine.motion) == (base.landmarks, base.prior, base.motion)


@pytest.mark.parametrize(
    ("overrides", "kind", "expected"),
    [
        ("sensor.max_range=7", Rays, {"s_max": 7.0}),
        ("fis.s_max=20", Rays, {"s_max": 20.0}),
        ("sensor.max_range=20 initialisation=delayed", Delayed, {"spacing": 0.4}),
        ("initialisation=delayed delayed.spacing=0.1", Delayed, {"spacing": 0.1}),
    ],
)
def test_initialisations_are_fitted_to_the_range_unless_set(overrides: str, kind: type, expected: dict[str, float]):
    settings = load_scenario("q4-ring", overrides.split()).initialisation_settings
    assert isinstance(settings, kind)
    assert {key: getattr(settings, key) for key in expected} == expected
    assert load_scenario("q1-long-dense").initialisation_settings is None


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios() if name.startswith("q1-")])
def test_question_1_uses_the_constants_of_the_exercise(name: str):
    scenario = load_scenario(name)
    [segment] = segmented(scenario).segments
    assert (scenario.trajectory.step, segment.speed, scenario.sensor.max_range) == (0.1, 1.0, 10.0)
    assert (scenario.motion.sigma_speed, scenario.motion.sigma_yaw_rate_deg) == (0.3, 3.0)
    assert (scenario.sensor.sigma_range, scenario.sensor.sigma_bearing_deg) == (0.1, 5.0)
    assert segment.duration * segment.yaw_rate == pytest.approx(4 * np.pi, rel=1e-3)
    assert scenario.prior.mean == (0.0, 0.0, 0.0)


def test_questions_2_and_3_are_question_1_with_another_association_and_noise():
    meant = {name: (name.replace("q2", "q1"), 9, 1) for name in ("q2-short-dense", "q2-long-dense", "q2-long-sparse")}
    meant |= {f"q2-gate-{gate}": ("q1-long-dense", gate, 1) for gate in (1, 100)}
    meant |= {f"q3-scale-{scale}": ("q1-long-sparse", 9, scale) for scale in (0.1, 1, 2, 10)}
    for name, (base, gate, scale) in meant.items():
        scenario, known = load_scenario(name), load_scenario(base)
        assert (scenario.association.method, scenario.association.gate) == ("nearest-neighbour", gate)
        assert scenario.association.map_management is None
        assert scenario.assumed.scale == scale
        parts = ("start", "prior", "trajectory", "motion", "sensor", "landmarks")
        assert all(getattr(scenario, part) == getattr(known, part) for part in parts)


@pytest.mark.parametrize(
    ("name", "fewest", "most"), [("q1-short-dense", 16, 20), ("q1-long-dense", 34, 40), ("q1-long-sparse", 4, 6)]
)
def test_dense_maps_keep_eight_landmarks_in_view_and_the_sparse_one_none_for_most_of_a_loop(
    name: str, fewest: int, most: int
):
    truth, _ = simulate(load_scenario(name, ["start=mean"]), 0)
    landmarks, poses = given(truth.landmarks), given(truth.poses)
    distance = np.linalg.norm(poses[:, None, :2] - landmarks, axis=2)
    in_view = (distance <= 10.0).sum(axis=1)
    assert fewest <= len(landmarks) <= most
    assert distance.min() >= 1.5
    if name == "q1-long-sparse":
        assert all((each == 0).mean() > 0.6 for each in np.array_split(in_view, 2))
        assert np.linalg.norm(landmarks, axis=1).max() < 6.0
    else:
        assert in_view.min() >= 8


# --- mistakes: a line for each, with its place and a remedy ----------------------------------------


def mistakes(path: str, *overrides: str) -> list[str]:
    with pytest.raises(UserError) as caught:
        load_scenario(path, overrides)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


def test_four_planted_mistakes_are_reported_together(write: Write):
    text = GOOD.replace("step = 0.1", "step = -0.1").replace("max_range = 5", 'max_range = "5"')
    text = text.replace("duration = 1.04", "duraton = 1.04").replace("[[1, 2]", "[[1, nan]")
    assert mistakes(write(text)) == [
        "trajectory.step: input should be greater than 0, not -0.1",
        "trajectory.segments[1].duraton: unknown key; did you mean duration?",
        "sensor.max_range: input should be a valid number, not '5'",
        "landmarks.positions[0][1]: input should be a finite number, not nan",
    ]


@pytest.mark.parametrize(
    ("old", "new", "mistake"),
    [
        ("sigma_position = 0.2", "", "sensor.sigma_position: missing; a position sensor needs it"),
        ("max_range", "sigma_range = 1\nmax_range", "sensor.sigma_range: a position sensor has none; remove it or"),
        ('"position"', '"radar"', "sensor.kind: input should be 'range-bearing', 'bearing' or 'position', not 'radar'"),
        ("max_range", "min_range = 6\nmax_range", "sensor.min_range: must not exceed max_range"),
        ("step = 0.1", "step = 0.1\nspeed = 1.0", "trajectory: has both forms; give segments, or speed, yaw_rate"),
        ("step = 0.1", "step = 1e-9", "trajectory: duration / step comes to more than 1000000 steps"),
        ("[motion]", "[motions]", "motions: unknown key; did you mean motion?"),
        ("description", "name = 'x'\ndescription", "name: unknown key; the file's own name is the scenario's name"),
        ("sigma_speed = 0.1", "sigma_speed = true", "motion.sigma_speed: input should be a valid number, not True"),
        ("[motion]", "[prior]\nmean = [0, 0, 0, 0]\n[motion]", "prior.mean: tuple should have at most 3 items"),
    ],
)
def test_each_mistake_has_its_line(write: Write, old: str, new: str, mistake: str):
    [line] = mistakes(write(GOOD.replace(old, new)))
    assert line.startswith(mistake)


TOO_MANY = "members from s_min to s_max; choose it larger, for 1000 members at most"
OVERRIDES = {  # by scenario: override, and its line, or the begin of a long one
    "q1-short-dense": {
        "trajectory={kind='spiral', step=1}": "trajectory: kind is not known; use one of segments, waypoints, ",
        "trajectory.radius=3": "trajectory.radius: a trajectory of the kind segments has none; remove it or change",
        "trajectory={kind='waypoints', step=1, points=[], speed=1, yaw_rate=1}": "trajectory.points: tuple should",
        "trajectory={kind='csv', file='none.csv'}": "trajectory.file: none.csv: cannot be read (No such file",
        "trajectory.speed=1e60": "trajectory.speed: must be at most 1e+50 in size, not 1e+60",
        "trajectory.sped=2": "trajectory.sped: unknown key; did you mean speed?",
        f"sensor.{'a' * 5000}=1": f"sensor.{'a' * 80}",
        f"sensor.max_range={'1' * 5000}": "sensor.max_range: input should be a valid number, not '1111",
        "prior.covariance=[[1,0,0],[0,-1,0],[0,0,1]]": "prior.covariance: covariance[0] = ",
        "landmarks={positions=[[1, 2]], random={count=3, box=[0,0,1,1]}}": "landmarks: has both forms; give positions",
        "landmarks={}": "landmarks: has no landmarks; give positions ([] for none), or random",
        "landmarks={random={count=9, box=[0,0,1,0]}}": "landmarks.random: box is empty; give [x from, y from, ",
        "landmarks={random={count=9, box=[0,0,1,1], min_distance=1}}": "landmarks.random: only 1 of 9 landmarks fit at "
        "min_distance = 1.0; lower it or enlarge the box",
    },
    "q2-long-dense": {
        "association.gate=0": "association.gate: 0.0 is out of range; choose it above 0",
    },
    "q4-ring": {
        "fis.s_max=5": "fis.s_max = 5.0 m is shorter than sensor.max_range = 10.0 m; farther landmarks would be lost",
        "fis.s_min=10": "fis.s_max: 10.0 m must be beyond s_min, 10.0 m; choose it larger",
        "fis.s_min=1e-307": f"fis.beta: 1.7 gives 1337 {TOO_MANY}",
        "fis.alpha=1": "fis.alpha: 1.0 is out of range; choose it above 0 and below 1",
        "fis.beta=1.000001": f"fis.beta: 1.000001 gives 693149 {TOO_MANY}",
        "delayed.poses=2": "delayed.poses: 2 is out of range; choose it at least 3",
    },
}
ROWS = [(scenario, *row) for scenario, rows in OVERRIDES.items() for row in rows.items()]


@pytest.mark.parametrize(("scenario", "override", "line"), ROWS)
def test_a_mistake_is_one_short_line(scenario: str, override: str, line: str) -> None:
    with pytest.raises(UserError, match=r"^[^\n]{1,400}$") as caught:
        load_scenario(scenario, [override])
    assert str(caught.value).startswith(f"{scenario}: {line}")


def test_unknown_names_list_near_misses_or_all() -> None:
    assert "did you mean q1-long-dense" in mistakes("q1-long-dens")[0]
    assert all(name in mistakes("zzz")[0] for name, _ in shipped_scenarios())


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a = 1\nb = = 2\n", r"not valid TOML: [^\n]* \(at line 2, [^\n]*"),
        (f"[sensor]\nmax_range = {'[' * 3000}{']' * 3000}\n", r"not valid TOML: [^\n]{1,200}"),
        ('extends = "q2-long-dens"', "extends: 'q2-long-dens' is not a shipped scenario; did you mean q2-long-dense.*"),
        ("extends = {a = 1}", r"extends: [^\n]+ is not a shipped scenario; [^\n]+"),
        (f"extends = {'1' * 4000}", r"extends: '.{100}' is not a shipped scenario; [^\n]+"),
    ],
)
def test_texts_that_are_no_scenario_are_a_line(write: Write, text: str, line: str):
    [mistake] = mistakes(write(text))
    assert re.fullmatch(line, mistake)


def test_files_and_overrides_that_cannot_be_read(tmp_path: Path):
    assert mistakes(str(tmp_path / "none.toml")) == [
        "cannot be read (No such file or directory); check the path and its permissions"
    ]
    (tmp_path / "latin.toml").write_bytes(b'description = "\xe9"')
    with pytest.raises(UserError, match=r"latin\.toml, line 1: not a text in UTF-8; give another file, or"):
        load_scenario(tmp_path / "latin.toml")
    for override in ("start", "=1"):
        with pytest.raises(UserError, match=rf"^{override}: not an override; write dotted\.key=value$"):
            load_scenario("q1-long-sparse", [override])
    line = 'association.method = "jcbb" needs rays; set initialisation = "fis", or the method "known"'
    assert mistakes("q4-ring", "association.method=jcbb", "initialisation=delayed") == [line]


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("stamp,x,y,theta\n0,0,0,0\n", "path.csv: 1 poses; give 2 to 1000001"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,nan\n", "path.csv, line 3, column 4: 'nan' is not a finite number"),
        ("stamp,x,y,theta\n0,0,0,0\n1,1,0,0\n1,2,0,0\n", "path.csv, line 4: stamps must increase; sort the rows"),
        ("stamp,x,y,theta\n0,1,0,0\n1,1,0,0\n", "prior.mean: [0.0, 0.0, 0.0] is not where the path of path.csv"),
        ("step,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n1,1,0,0,1,0,1\n", "motion.sigma_speed: motion.covariances"),
    ],
)
def test_mistakes_in_files_of_a_scenario_are_located(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / "path.csv").write_text(path)
    section = "motion = {covariances" if path.startswith("step") else "trajectory = {kind = 'csv', file"
    (tmp_path / "my.toml").write_text(f"extends = 'q1-short-dense'\n{section} = 'path.csv'}}\n")
    with pytest.raises(UserError) as caught:
        load_scenario(tmp_path / "my.toml")
    (message,) = str(caught.value).splitlines()
    assert line in message
