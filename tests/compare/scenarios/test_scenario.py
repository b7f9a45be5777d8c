"""Scenario files: their meaning, overrides, extended scenarios, and the constants and maps of the shipped ones."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf.settings import Delayed, Rays
from tests.reference.given import given

from .conftest import GOOD, Write, segmented


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
