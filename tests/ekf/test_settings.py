"""Settings refuse invalid values in one line with value and remedy, and depend on the sensor's reach."""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.ekf.setting_rules import fitted
from slamgauge.ekf.settings import Association, Delayed, MapManagement, Rays, Robustness
from slamgauge.errors import UserError


@pytest.mark.parametrize(
    ("kind", "chosen", "message"),
    [
        (Association, {"method": "jccb"}, "method: 'jccb' is not known; did you mean jcbb?"),
        (Association, {"method": "x"}, "method: 'x' is not known; use nearest-neighbour, jcbb"),
        (Association, {"gate": -1}, "gate: -1 is out of range; choose it above 0"),
        (Association, {"gate": True}, "gate: True is not a finite number; choose it above 0"),
        (Association, {"method": ["jcbb"]}, "method: ['jcbb'] is not known; did you mean jcbb?"),
        (Association, {"map_management": 1}, "map_management: 1 is not MapManagement; give MapManagement() or None"),
        (MapManagement, {"sights": 11}, "sights: 11 do not fit into 10 scans of probation; choose at most 10"),
        (MapManagement, {"merge_gate": -1.0}, "merge_gate: -1.0 is out of range; choose it at least 0"),
        (Rays, {"s_min": 10.0}, "s_max: 10.0 m must be beyond s_min, 10.0 m; choose it larger"),
        (Rays, {"s_max": float("inf")}, "s_max: inf is not a finite number; choose it above 0"),
        (Rays, {"alpha": 1.0}, "alpha: 1.0 is out of range; choose it above 0 and below 1"),
        (Delayed, {"poses": 2}, "poses: 2 is out of range; choose it at least 3"),
        (Robustness, {"robust": "huber"}, "robust: 'huber' is not known; use none, gate, student-t"),
        (Robustness, {"degrees_of_freedom": -1}, "degrees_of_freedom: -1 is out of range; choose it above 0"),
        (Association, {"node_limit": 0}, "node_limit: 0 is out of range; choose it at least 1"),
        (MapManagement, {"sights": 0}, "sights: 0 is out of range; choose it at least 1"),
        (Rays, {"lost_after": 2.5}, "lost_after: 2.5 is not a whole number; choose it at least 1"),
        (Rays, {"alpha": 0.0}, "alpha: 0.0 is out of range; choose it above 0 and below 1"),
        (Rays, {"beta": 1.0}, "beta: 1.0 is out of range; choose it above 1"),
        (Rays, {"s_min": 0.0}, "s_min: 0.0 is out of range; choose it above 0"),
        (Rays, {"s_max": 0.5}, "s_max: 0.5 m must be beyond s_min, 3.0 m; choose it larger"),
        (Rays, {"threshold": 1.0}, "threshold: 1.0 is out of range; choose it above 0 and below 1"),
        (Rays, {"gate": 0.0}, "gate: 0.0 is out of range; choose it above 0"),
        (Delayed, {"sure": 0.0}, "sure: 0.0 is out of range; choose it above 0"),
        (Robustness, {"gate": 0.0}, "gate: 0.0 is out of range; choose it above 0"),
        (MapManagement, {"sights": 2.5}, "sights: 2.5 is not a whole number; choose it at least 1"),
    ],
)
def test_invalid_settings(kind: type, chosen: dict[str, object], message: str):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        kind(**chosen)


@pytest.mark.parametrize("kind", [Association, MapManagement, Rays, Delayed, Robustness])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1, "1", True, None, 1j, [1.0]], ids=str)
def test_every_number_of_a_setting_is_checked(kind: type, value: object):
    numbers = [each.name for each in fields(kind) if isinstance(each.default, (int, float))]
    assert numbers
    for key in numbers:
        with pytest.raises(UserError, match=rf"^{key}: [^\n]*; [^\n]*$"):
            kind(**{key: value})


def test_numpy_numbers_become_python_numbers():
    """Otherwise kernels would be compiled again for their types."""
    chosen = Association(gate=np.float32(4.0), node_limit=np.int64(7))  # pyrefly: ignore[bad-argument-type]
    assert (type(chosen.gate), type(chosen.node_limit)) == (float, int)
    assert chosen == Association(gate=4, node_limit=7)


@pytest.mark.parametrize("reach", [0.0, -1.0, float("nan"), float("inf"), "10", None, True], ids=str)
@pytest.mark.parametrize("kind", [Rays, Delayed])
def test_invalid_reaches(kind: type, reach: object):
    with pytest.raises(UserError, match=r"^reach: \S+ is not a distance; give metres above 0, for example 10$"):
        fitted(kind, reach)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("kind", [Rays, Delayed])
def test_the_defaults_are_for_a_reach_of_ten_metres(kind: type):
    assert fitted(kind, 10.0) == kind()


def test_chosen_values_are_kept_and_others_fitted():
    assert MapManagement(sights=10, probation=10).sights == 10
    assert fitted(Rays, 20.0, s_max=15.0, s_min=None) == Rays(s_min=6.0, s_max=15.0)


@pytest.mark.parametrize(
    ("section", "kind", "initialisation"),
    [("fis", Rays, "fis"), ("delayed", Delayed, "delayed")],
)
def test_a_scenario_can_set_every_field(section: str, kind: type, initialisation: str):
    chosen = {each.name: 2 * getattr(kind(), each.name) for each in fields(kind) if each.name != "alpha"}
    overrides = [f"{section}.{key}={value}" for key, value in chosen.items()]
    scenario = load_scenario("q4-ring", [f"initialisation={initialisation}", *overrides])
    assert scenario.initialisation_settings == kind(**chosen)
