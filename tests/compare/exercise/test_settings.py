"""Settings that conclusions compare have the same measurements, as far as their maps are the same."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.compare.exercise.settings import QUESTIONS, SETTINGS, require_questions
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.errors import UserError

SAME_MAP = (("2.1", "2.6"), ("2.2", "2.4", "2.5", "2.7"), ("2.3", "2.8", "3.1", "3.2", "3.3", "3.4"))


@pytest.mark.parametrize("figures", SAME_MAP, ids=lambda figures: figures[0])
def test_settings_with_the_same_map_have_the_same_measurements(figures: tuple[str, ...]):
    runs = [simulate_informed(load_scenario(SETTINGS[figure].scenario), 3) for figure in figures]
    first_truth, first, first_exact = runs[0]
    for truth, recording, exact in runs[1:]:
        np.testing.assert_array_equal(truth.poses, first_truth.poses)
        for key in ("odometry", "observation", "observation_step"):
            np.testing.assert_array_equal(getattr(recording, key), getattr(first, key))
            np.testing.assert_array_equal(getattr(exact, key), getattr(first_exact, key))
        for key in ("landmark", "odometry_cov", "observation_cov"):
            np.testing.assert_array_equal(getattr(exact, key), getattr(first_exact, key))


def test_settings_are_those_of_the_handout():
    """Known association in question 1, gates and assumed noise of questions 2 and 3, bearings in question 4."""
    scenarios = {figure: load_scenario(setting.scenario) for figure, setting in SETTINGS.items()}
    assert [*scenarios] == ["1.1", *(f"2.{k}" for k in range(1, 9)), *(f"3.{k}" for k in range(1, 5)), "4.1", "ring"]
    methods = {figure: each.association.method for figure, each in scenarios.items()}
    unknown = [figure for figure, method in methods.items() if method == "nearest-neighbour"]
    assert unknown == [each.figure for name in ("q2", "q3") for each in QUESTIONS[name].settings]
    gates = [scenarios[figure].association.gate for figure in unknown]
    assert gates == [1.0, 100.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0]
    assert [scenarios[f"3.{k}"].assumed.scale for k in range(1, 5)] == [0.1, 1.0, 10.0, 2.0]
    assert {figure for figure, each in scenarios.items() if each.sensor.kind == "bearing"} == {"4.1", "ring"}
    assert all(each.start == "sampled" for each in scenarios.values())


def test_questions_are_in_the_order_of_the_exercise():
    assert require_questions(("q3", "q1", "q3")) == ("q1", "q3")
    assert require_questions(()) == ("q1", "q2", "q3", "q4")
    with pytest.raises(UserError, match="question 'q0' is not known; use q1, q2, q3, q4"):
        require_questions(("q0",))
