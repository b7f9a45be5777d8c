"""Scenario files: their meaning, the messages about mistakes, and the shipped scenarios."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import Scenario, ScenarioError, load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.ekf.settings import Delayed, InverseDepth, Rays
from slamgauge.se2 import chain

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


def mistakes(path: str, *overrides: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, overrides)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


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


def test_scenarios_are_immutable_and_survive_a_dump():
    scenario = load_scenario("q1-short-dense")
    assert type(scenario).model_validate(scenario.model_dump()) == scenario
    with pytest.raises(ValueError, match="frozen"):
        setattr(scenario, "start", "sampled")  # noqa: B010 type checkers refuse an assignment


# --- overrides ---------------------------------------------------------------------------------


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
    random = load_scenario("q1-long-dense", [fixed, drawn]).landmarks.random
    assert random is not None
    assert random.count == 7
    assert load_scenario("q1-long-dense", [drawn, fixed]).landmarks.positions == ((1.0, 2.0),)


@pytest.mark.parametrize("override", ["start", "=1"])
def test_an_override_without_key_and_value(override: str):
    with pytest.raises(ScenarioError, match=r"write dotted\.key=value"):
        load_scenario("q1-long-sparse", [override])


def test_mistaken_overrides_of_a_single_segment_are_located():
    assert mistakes("q1-long-sparse", "trajectory.step=fast", "trajectory.speed=fast", "trajectory.sped=2") == [
        "trajectory.step: must be a valid number, not 'fast'",
        "trajectory.speed: must be a valid number, not 'fast'",
        "trajectory.sped: unknown key; did you mean speed?",
    ]


# --- mistakes ----------------------------------------------------------------------------------


def test_four_planted_mistakes_are_reported_together(write: Write):
    text = GOOD.replace("step = 0.1", "step = -0.1").replace("max_range = 5", 'max_range = "5"')
    text = text.replace("duration = 1.04", "duraton = 1.04").replace("[[1, 2]", "[[1, nan]")
    assert mistakes(write(text)) == [
        "trajectory.step: must be greater than 0, not -0.1",
        "trajectory.segments[1].duraton: unknown key; did you mean duration?",
        "sensor.max_range: must be a valid number, not '5'",
        "landmarks.positions[0][1]: must be a finite number, not nan",
    ]


@pytest.mark.parametrize(
    "section", ["", "prior", "trajectory", "trajectory.segments[0]", "motion", "sensor", "assumed", "landmarks"]
)
def test_unknown_keys_are_found_in_every_section(write: Write, section: str):
    text = GOOD + "[prior]\n[assumed]\n"
    if not section:
        text = "zzz = 1\n" + text
    elif section.endswith("]"):
        text = text.replace("[{", "[{zzz = 1, ")
    else:
        text = text.replace(f"[{section}]\n", f"[{section}]\nzzz = 1\n")
    [mistake] = mistakes(write(text))
    assert mistake.startswith(f"{section}.zzz: unknown key; use ".removeprefix("."))


def test_a_file_does_not_name_itself(write: Write):
    assert mistakes(write("name = 'x'\n" + GOOD)) == ["name: unknown key; the file's own name is the scenario's name"]


@pytest.mark.parametrize(
    ("old", "new", "mistake"),
    [
        ("sigma_position = 0.2", "", "sensor.sigma_position: missing; a position sensor needs it"),
        (
            "max_range",
            "sigma_range = 1\nmax_range",
            "sensor.sigma_range: a position sensor has none; remove it or change",
        ),
        ('"position"', '"radar"', "sensor.kind: must be 'range-bearing', 'bearing' or 'position', not 'radar'"),
        ("max_range", "min_range = 6\nmax_range", "sensor.min_range: must not exceed max_range"),
        ("step = 0.1", "step = 0.1\nspeed = 1.0", "trajectory: has both forms; give segments, or speed, yaw_rate"),
        ("step = 0.1", "step = 1e-9", "trajectory: duration / step comes to more than 1000000 steps"),
        ("[motion]", "[motions]", "motions: unknown key; did you mean motion?"),
        ("sigma_speed = 0.1", "sigma_speed = true", "motion.sigma_speed: must be a valid number, not True"),
        ("[[1, 2], [3.5, -1]]", "[[1, 2], 3.5]", "landmarks.positions[1]: must be a list, not 3.5"),
        ("[motion]", "[prior]\nmean = [0, 0, 0, 0]\n[motion]", "prior.mean: must have at most 3 items, not 4"),
        (
            "[motion]",
            "[prior]\nvariances = [0, -1, 0]\n[motion]",
            "prior.variances[1]: must be greater than or equal to 0",
        ),
    ],
)
def test_each_mistake_has_its_line(write: Write, old: str, new: str, mistake: str):
    [line] = mistakes(write(GOOD.replace(old, new)))
    assert line.startswith(mistake)


@pytest.mark.parametrize(("text", "line"), [("a = 1\nb = = 2\n", 2), ("a = 1\n\n[motion", 3)])
def test_syntax_errors_name_file_and_line(write: Write, text: str, line: int):
    [mistake] = mistakes(write(text))
    assert mistake.startswith("not valid TOML: ")
    assert f"at line {line}," in mistake


@pytest.mark.parametrize("value", ["[" * 3000 + "]" * 3000, "1" * 5000])
def test_values_beyond_the_limits_of_python_are_a_line(write: Write, value: str):
    path = write(f'extends = "q1-short-dense"\n[sensor]\nmax_range = {value}\n')
    for name, overrides in ((path, []), ("q1-short-dense", [f"sensor.max_range={value}"])):
        with pytest.raises(ScenarioError, match=r"^[^\n]{1,299}$"):
            load_scenario(name, overrides)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("trajectory.speed=1e60", "trajectory.speed: must be at most 1e+50 in size, not 1e+60"),
        (f"sensor.{'a' * 5000}=1", "unknown key"),
    ],
)
def test_long_keys_and_huge_numbers_are_a_short_line(override: str, message: str):
    with pytest.raises(ScenarioError, match=r"^[^\n]{1,400}$") as caught:
        load_scenario("q1-short-dense", [override])
    assert message in str(caught.value)


def test_unknown_names_list_near_misses_or_all():
    assert "did you mean q1-long-dense" in mistakes("q1-long-dens")[0]
    assert all(name in mistakes("zzz")[0] for name, _ in shipped_scenarios())


def test_files_that_cannot_be_read(tmp_path: Path):
    assert mistakes(str(tmp_path / "none.toml")) == ["cannot be read (No such file or directory); check the path"]
    (tmp_path / "latin.toml").write_bytes(b'description = "\xe9"')
    assert mistakes(str(tmp_path / "latin.toml")) == ["not a UTF-8 text; save it as UTF-8"]


# --- extending shipped scenarios -----------------------------------------------------------------


def test_a_file_may_extend_a_shipped_scenario_key_by_key(write: Write):
    text = 'extends = "q2-long-dense"\ndescription = "mine"\n[association]\ngate = 4\n[prior]\nvariances = [0, 0, 0]\n'
    mine, base = load_scenario(write(text)), load_scenario("q2-long-dense")
    assert (mine.name, mine.description) == ("my", "mine")
    assert (mine.association.method, mine.association.gate) == ("nearest-neighbour", 4.0)
    assert mine.prior.variances == (0.0, 0.0, 0.0)
    assert (mine.landmarks, mine.trajectory, mine.sensor) == (base.landmarks, base.trajectory, base.sensor)


def test_only_shipped_scenarios_can_be_extended(write: Write):
    assert mistakes(write('extends = "q2-long-dens"')) == [
        "extends: 'q2-long-dens' is not a shipped scenario; did you mean q2-long-dense?"
    ]
    for wrong in ("3", '["q1-long-dense"]', "{a = 1}"):
        assert "is not a shipped scenario; " in mistakes(write(f"extends = {wrong}"))[0]
    for long in ("1" * 4000, f'"{"q" * 5000}"', f"[[{'1' * 4000}]]"):
        assert re.match(r"extends: '.{100}' is not a shipped scenario; ", mistakes(write(f"extends = {long}"))[0])


def test_a_section_of_another_form_replaces_the_extended_one(write: Write):
    text = """extends = "q1-long-dense"
[trajectory]
step = 0.5
segments = [{speed = 1.0, yaw_rate = 0.0, duration = 2.0}]
[sensor]
kind = "position"
max_range = 5.0
sigma_position = 0.1
"""
    scenario = load_scenario(write(text))
    assert segmented(scenario).steps == (4,)
    assert (scenario.sensor.kind, scenario.sensor.sigma_range) == ("position", None)


def test_mistakes_of_the_association():
    overrides = ("association.method=nearest", "association.gate=0", "association.gat=9")
    assert mistakes("q2-long-dense", *overrides) == [
        "association.method: must be 'known', 'nearest-neighbour' or 'jcbb', not 'nearest'",
        "association.gate: 0.0 is out of range; choose it above 0",
        "association.gat: unknown key; did you mean gate?",
    ]


@pytest.mark.parametrize(
    ("name", "base", "gate", "scale"),
    [
        ("q2-short-dense", "q1-short-dense", 9, 1),
        ("q2-long-dense", "q1-long-dense", 9, 1),
        ("q2-long-sparse", "q1-long-sparse", 9, 1),
        ("q2-gate-1", "q1-long-dense", 1, 1),
        ("q2-gate-100", "q1-long-dense", 100, 1),
        ("q3-scale-0.1", "q1-long-sparse", 9, 0.1),
        ("q3-scale-1", "q1-long-sparse", 9, 1),
        ("q3-scale-2", "q1-long-sparse", 9, 2),
        ("q3-scale-10", "q1-long-sparse", 9, 10),
    ],
)
def test_questions_2_and_3_are_question_1_with_another_association_and_noise(
    name: str, base: str, gate: float, scale: float
):
    scenario, known = load_scenario(name), load_scenario(base)
    assert scenario.name == name
    assert (scenario.association.method, scenario.association.gate) == ("nearest-neighbour", gate)
    assert scenario.association.map_management is None
    assert scenario.assumed.scale == scale
    parts = ("start", "prior", "trajectory", "motion", "sensor", "landmarks")
    assert all(getattr(scenario, part) == getattr(known, part) for part in parts)


# --- bearing-only --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "mistake"),
    [
        ("fis.s_max=5", "fis.s_max = 5.0 m is shorter than sensor.max_range = 10.0 m; farther landmarks would be lost"),
        (
            "association.method=jcbb initialisation=delayed",
            'association.method = "jcbb" needs rays; set initialisation = "fis", or the method "known"',
        ),
        ("fis.s_min=10", "fis.s_max: 10.0 m must be beyond s_min, 10.0 m; choose it larger"),
        ("fis.alpha=1", "fis.alpha: 1.0 is out of range; choose it above 0 and below 1"),
        ("fis.beta=1", "fis.beta: 1.0 is out of range; choose it above 1"),
        (
            "fis.beta=1.000001",
            "fis.beta: 1.000001 gives 693149 members from s_min to s_max; choose it larger, for 1000 members at most",
        ),
        (
            "fis.s_min=1e-307",
            "fis.beta: 1.7 gives 1337 members from s_min to s_max; choose it larger, for 1000 members at most",
        ),
        ("initialisation=ekf", "initialisation: must be 'fis', 'inverse-depth' or 'delayed', not 'ekf'"),
        ("delayed.poses=2", "delayed.poses: 2 is out of range; choose it at least 3"),
        ("inverse_depth.mean=0", "inverse_depth.mean: 0.0 is out of range; choose it above 0"),
        ("sensor.sigma_range=1", "sensor.sigma_range: a bearing sensor has none; remove it or change kind"),
    ],
)
def test_impossible_initialisations(overrides: str, mistake: str):
    [line] = mistakes("q4-ring", *overrides.split())
    assert line.endswith(mistake)


@pytest.mark.parametrize(
    ("overrides", "kind", "expected"),
    [
        ("sensor.max_range=7", Rays, {"s_max": 7.0}),
        ("fis.s_max=20", Rays, {"s_max": 20.0}),
        ("sensor.max_range=20 initialisation=inverse-depth", InverseDepth, {"mean": 0.075, "sigma": 0.025}),
        ("sensor.max_range=20 initialisation=delayed", Delayed, {"spacing": 0.4}),
        ("initialisation=delayed delayed.spacing=0.1", Delayed, {"spacing": 0.1}),
    ],
)
def test_initialisations_are_fitted_to_the_range_unless_set(overrides: str, kind: type, expected: dict[str, float]):
    settings = load_scenario("q4-ring", overrides.split()).initialisation_settings
    assert isinstance(settings, kind)
    assert {key: getattr(settings, key) for key in expected} == expected
    assert load_scenario("q1-long-dense").initialisation_settings is None


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios()])
def test_pickling_keeps_a_scenario(name: str) -> None:
    scenario = load_scenario(name)
    assert pickle.loads(pickle.dumps(scenario)) == scenario


# --- paths, maps and errors ----------------------------------------------------------------------


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
        (
            "landmarks={positions=[[1, 2]], random={count=3, box=[0,0,1,1]}}",
            "landmarks: has both forms; give positions, or random",
        ),
        ("landmarks={}", "landmarks: has no landmarks; give positions ([] for none), or random"),
        ("landmarks={random={count=9, box=[0,0,1,0]}}", "landmarks.random: box is empty; give [x from, y from,"),
        (
            "landmarks={random={count=9, box=[0,0,1,1], min_distance=1}}",
            "landmarks.random: only 1 of 9 landmarks fit at min_distance = 1.0; lower it or enlarge the box",
        ),
    ],
)
def test_a_mistake_is_one_line(override: str, line: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("q1-short-dense", [override])
    (message,) = str(caught.value).splitlines()
    assert message.startswith(f"q1-short-dense: {line}")


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
def test_mistakes_in_files_of_a_scenario_are_located(tmp_path: Path, path: str, line: str) -> None:
    (tmp_path / "path.csv").write_text(path)
    (tmp_path / "my.toml").write_text("extends = 'q1-short-dense'\ntrajectory = {kind = 'csv', file = 'path.csv'}\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / "my.toml")
    (message,) = str(caught.value).splitlines()
    assert line in message


def test_a_table_of_covariances_excludes_sigmas(tmp_path: Path) -> None:
    (tmp_path / "noise.csv").write_text("step,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n1,1,0,0,1,0,1\n")
    (tmp_path / "my.toml").write_text(
        "extends = 'q1-short-dense'\n[motion]\ncovariances = 'noise.csv'\nsigma_lateral = 0.1\n"
    )
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / "my.toml")
    assert "motion.sigma_lateral: motion.covariances has the noise already; remove one of them" in str(caught.value)


# --- shipped scenarios ---------------------------------------------------------------------------


def distances(name: str) -> tuple[Float, Float]:
    """Return distances (N+1, L) from every pose of the path to every landmark, and the landmarks (L, 2)."""
    scenario = load_scenario(name)
    [segment] = segmented(scenario).segments
    step = scenario.trajectory.step
    command = np.tile([segment.speed * step, 0.0, segment.yaw_rate * step], (segmented(scenario).steps[0], 1))
    positions = chain(scenario.prior.mean, command)[:, :2]
    landmarks = np.array(scenario.landmarks.positions)
    return np.linalg.norm(positions[:, None] - landmarks, axis=2), landmarks


@pytest.mark.parametrize(("name", "count"), [("q1-short-dense", (16, 20)), ("q1-long-dense", (34, 40))])
def test_dense_maps_keep_eight_landmarks_in_view(name: str, count: tuple[int, int]):
    distance, landmarks = distances(name)
    assert count[0] <= len(landmarks) <= count[1]
    assert (distance <= 10.0).sum(axis=1).min() >= 8
    assert distance.min() >= 1.5


def test_the_sparse_map_is_out_of_view_for_most_of_each_loop():
    distance, landmarks = distances("q1-long-sparse")
    blind = distance.min(axis=1) > 10.0
    half = len(distance) // 2
    assert 4 <= len(landmarks) <= 6
    assert blind[:half].mean() > 0.6
    assert blind[half:].mean() > 0.6
    assert np.linalg.norm(landmarks, axis=1).max() < 6.0
    assert distance.min() >= 1.5


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios() if name.startswith("q1-")])
def test_question_1_uses_the_constants_of_the_exercise(name: str):
    scenario = load_scenario(name)
    [segment] = segmented(scenario).segments
    assert (scenario.trajectory.step, segment.speed, scenario.sensor.max_range) == (0.1, 1.0, 10.0)
    assert (scenario.motion.sigma_speed, scenario.motion.sigma_yaw_rate_deg) == (0.3, 3.0)
    assert (scenario.sensor.sigma_range, scenario.sensor.sigma_bearing_deg) == (0.1, 5.0)
    assert segment.duration * segment.yaw_rate == pytest.approx(4 * np.pi, rel=1e-3)
    assert scenario.prior.mean == (0.0, 0.0, 0.0)
