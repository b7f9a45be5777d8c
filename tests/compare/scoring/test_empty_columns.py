"""Columns without any figure are named in one line below the table, and in metrics.json."""

from __future__ import annotations

import numpy as np

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.comparison import compare_estimators, metrics, table
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording


def path_alone(recording: Recording) -> Estimate:
    return Estimate(kind="filtered", poses=np.zeros((recording.steps + 1, 3)))


def test_columns_are_named_only_where_no_estimator_has_a_figure() -> None:
    truth, recording = simulate(load_scenario("q1-long-dense", ["trajectory.duration=2"]), 0)
    for known, names, empty, single in (
        (truth, ["batch"], "NIS/dof", True),
        (truth, ["ekf"], "x optimum, d to optimum, nats to optimum, end to batch [m]", True),
        (None, ["ekf", "batch"], "ATE [m], x optimum, NEES, in 95% ellipse, heading [rad], end [m]", False),
    ):
        found = compare_estimators(known, recording, load_estimators(names) | {"mine": path_alone})
        notes, lines = metrics(found, None, None)["notes"], str(table(found)).splitlines()
        assert notes[0].startswith(f"empty: {empty}")
        assert any(note.startswith("a single run") for note in notes) == single
        assert all(note in lines for note in notes)
