"""Scenario files: what they mean, and how their mistakes are reported."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import Scenario, ScenarioError, load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.ekf.settings.initialisation import Delayed, InverseDepth, Rays

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
    assert scenario.start == "mean"
    assert scenario.prior.variances == (0.01, 0.01, 0.0001)
    assert scenario.assumed.motion_scale == scenario.assumed.sensor_scale == 1.0
    assert segmented(scenario).steps == (20, 10)
    assert scenario.landmarks.positions == ((1.0, 2.0), (3.5, -1.0))
    np.testing.assert_array_equal(scenario.sensor.sigmas, [0.2, 0.2])


def test_speed_yaw_rate_and_duration_are_one_segment():
    trajectory = segmented(load_scenario("q1-long-dense"))
    assert [segment.yaw_rate for segment in trajectory.segments] == [0.1]
    assert trajectory.steps == (1257,)


def test_a_segment_has_at_least_one_step(write: Write):
    assert segmented(load_scenario(write(GOOD.replace("1.04", "0.01")))).steps == (20, 1)


def test_degrees_become_radians():
    np.testing.assert_allclose(load_scenario("q1-long-dense").sensor.sigmas, [0.1, np.deg2rad(5.0)], rtol=1e-15)


def test_scenarios_are_immutable_and_survive_a_dump():
    scenario = load_scenario("q1-short-dense")
    assert type(scenario).model_validate(scenario.model_dump()) == scenario
    with pytest.raises(ValueError, match="frozen"):
        scenario.start = "sampled"


# --- overrides ---------------------------------------------------------------------------------


def test_overrides_are_toml_values_or_bare_strings():
    overrides = [
        "start=sampled",
        "trajectory.yaw_rate = -0.2",
        "prior.variances=[0, 0, 0]",
        "description=an east-west run",
    ]
    scenario = load_scenario("q1-long-sparse", overrides)
    assert scenario.start == "sampled"
    assert segmented(scenario).segments[0].yaw_rate == -0.2
    assert scenario.prior.variances == (0.0, 0.0, 0.0)
    assert scenario.description == "an east-west run"


def test_an_override_may_begin_a_section():
    assert load_scenario("q1-long-sparse", ["assumed.motion_scale=2"]).assumed.motion_scale == 2.0


def test_an_override_replaces_a_whole_section():
    overrides = ["sensor={kind='position', max_range=10, sigma_position=0.2}"]
    assert load_scenario("q1-long-sparse", overrides).sensor.sigma_range is None


@pytest.mark.parametrize("override", ["start", "=1"])
def test_an_override_without_key_and_value(override: str):
    with pytest.raises(ScenarioError, match=r"write dotted\.key=value"):
        load_scenario("q1-long-sparse", [override])


def test_a_wrong_override_is_located():
    assert mistakes("q1-long-sparse", "trajectory.step=fast", "trajectory.sped=2") == [
        "trajectory.step: must be a valid number, not 'fast'",
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


def test_a_mistaken_single_segment_is_located_where_it_was_written():
    assert mistakes("q1-long-dense", "trajectory.speed=fast") == [
        "trajectory.speed: must be a valid number, not 'fast'"
    ]


@pytest.mark.parametrize(("text", "line"), [("a = 1\nb = = 2\n", 2), ("a = 1\n\n[motion", 3)])
def test_syntax_errors_name_file_and_line(write: Write, text: str, line: int):
    [mistake] = mistakes(write(text))
    assert mistake.startswith("not valid TOML: ")
    assert f"at line {line}," in mistake


@pytest.mark.parametrize("value", ["[" * 3000 + "]" * 3000, "1" * 5000])
def test_values_that_python_cannot_read_are_a_line(write: Write, value: str):
    path = write(f'extends = "q1-short-dense"\n[sensor]\nmax_range = {value}\n')
    for load in (lambda: load_scenario(path), lambda: load_scenario("q1-short-dense", [f"sensor.max_range={value}"])):
        with pytest.raises(ScenarioError) as caught:
            load()
        assert len(str(caught.value)) < 300
        assert "\n" not in str(caught.value)


def test_keys_and_numbers_of_no_believable_size_are_a_short_line():
    for override, told in (
        ("trajectory.speed=1e60", "trajectory.speed: must be at most 1e+50 in size, not 1e+60"),
        (f"sensor.{'a' * 5000}=1", "unknown key"),
    ):
        with pytest.raises(ScenarioError, match=r"^[^\n]{1,400}$") as caught:
            load_scenario("q1-short-dense", [override])
        assert told in str(caught.value)


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


def test_extending_what_is_not_shipped(write: Write):
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
        "association.gate: 0.0 lets nothing pass; choose it above 0",
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


# --- bearings alone ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "mistake"),
    [
        (
            ["fis.s_max=5"],
            "fis.s_max = 5.0 m is shorter than sensor.max_range = 10.0 m; farther landmarks would be lost",
        ),
        (
            ["association.method=jcbb", "initialisation=delayed"],
            'association.method = "jcbb" needs rays; set initialisation = "fis", or the method "known"',
        ),
        (["fis.s_min=10"], "fis.s_max: 10.0 m must lie beyond s_min, 10.0 m; choose it farther"),
        (
            ["fis.alpha=1"],
            "fis.alpha: 1.0 is no share of a distance; choose it above 0 and below 1",
        ),
        (
            ["fis.beta=1"],
            "fis.beta: 1.0 makes no progression; choose it above 1",
        ),
        (
            ["fis.beta=1.000001"],
            "fis.beta: 1.000001 makes 693149 members of a ray from s_min to s_max; choose it larger, "
            "for 1000 members at most",
        ),
        (
            ["fis.s_min=1e-307"],
            "fis.beta: 1.7 makes 1337 members of a ray from s_min to s_max; choose it larger, for 1000 members at most",
        ),
        (["initialisation=ekf"], "initialisation: must be 'fis', 'inverse-depth' or 'delayed', not 'ekf'"),
        (["delayed.poses=2"], "delayed.poses: 2 place no landmark; choose at least 3"),
        (["inverse_depth.mean=0"], "inverse_depth.mean: 0.0 1/m is no inverse distance; choose it above 0"),
        (["sensor.sigma_range=1"], "sensor.sigma_range: a bearing sensor has none; remove it or change kind"),
    ],
)
def test_rays_that_cannot_be(overrides: list[str], mistake: str):
    [line] = mistakes("q4-ring", *overrides)
    assert line.endswith(mistake)


def test_rays_reach_as_far_as_the_sensor_unless_it_is_said_otherwise():
    for override, s_max in (("sensor.max_range=7", 7.0), ("fis.s_max=20", 20.0)):
        rays = load_scenario("q4-ring", [override]).initialisation_settings
        assert isinstance(rays, Rays)
        assert rays.s_max == s_max
    assert load_scenario("q1-long-dense").initialisation_settings is None


def test_the_other_initialisations_are_fitted_to_the_sensor_too():
    far = ["sensor.max_range=20"]
    depth = load_scenario("q4-ring", [*far, "initialisation=inverse-depth"]).initialisation_settings
    assert isinstance(depth, InverseDepth)
    assert (depth.mean, depth.sigma) == (0.075, 0.025)
    delayed = load_scenario("q4-ring", [*far, "initialisation=delayed"]).initialisation_settings
    assert isinstance(delayed, Delayed)
    assert delayed.spacing == 0.4
    nearer = load_scenario("q4-ring", ["initialisation=delayed", "delayed.spacing=0.1"]).initialisation_settings
    assert isinstance(nearer, Delayed)
    assert nearer.spacing == 0.1


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios()])
def test_a_scenario_reaches_another_process_as_it_is(name: str) -> None:
    scenario = load_scenario(name)
    assert pickle.loads(pickle.dumps(scenario)) == scenario
