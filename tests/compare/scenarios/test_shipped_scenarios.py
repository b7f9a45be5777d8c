"""The shipped scenarios: constants of the exercise, maps, and what differs between questions."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import load_scenario, shipped_scenarios
from slamgauge.compare.scenarios.simulation import simulate
from tests.reference.given import given

from .conftest import segmented


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios() if name.startswith("q1-")])
def test_question_1_uses_the_constants_of_the_exercise(name: str):
    scenario = load_scenario(name)
    [segment] = segmented(scenario).segments
    assert (scenario.trajectory.step, segment.speed, scenario.sensor.max_range) == (0.1, 1.0, 10.0)
    assert (scenario.motion.sigma_speed, scenario.motion.sigma_yaw_rate_deg) == (0.3, 3.0)
    assert (scenario.sensor.sigma_range, scenario.sensor.sigma_bearing_deg) == (0.1, 5.0)
    assert segment.duration * segment.yaw_rate == pytest.approx(4 * np.pi, rel=1e-3)
    assert scenario.prior.mean == (0.0, 0.0, 0.0)


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
