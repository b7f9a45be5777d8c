"""Why columns are empty: each reason once, and only where all of a column is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.catalogue import CATALOGUE
from slamgauge.compare.scoring.comparison import compare_estimators, metrics, table
from slamgauge.compare.scoring.empty_columns import REASONS, empty_lines
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


def path_alone(recording: Recording) -> Estimate:
    return Estimate(kind="filtered", poses=np.zeros((recording.steps + 1, 3)))


@pytest.fixture(scope="module")
def run() -> tuple[Truth, Recording]:
    return simulate(load_scenario("q1-long-dense", ["trajectory.duration=2"]), 0)


def lines_of(truth: Truth | None, recording: Recording, *names: str) -> list[str]:
    estimators = {name: path_alone for name in names if name == "mine"}
    found = compare_estimators(truth, recording, load_estimators([n for n in names if n != "mine"]) | estimators)
    return [line for line in str(table(found)).splitlines() if line.startswith("empty:")]


def test_every_need_has_its_reason():
    needs = {need for each in CATALOGUE if each.column is not None for need in each.column.needs}
    assert needs == {*REASONS}


def test_the_first_need_that_is_missing_is_the_reason():
    empty = [("NEES", ("truth", "covariances")), ("ATE", ("truth",)), ("NIS", ("nis",)), ("of", ("map",))]
    assert empty_lines(empty, {"map"}) == [
        "empty: NEES, ATE: the truth is not known (no truth.npz)",
        "empty: NIS: no estimate has `nis` and `nis_dof`",
    ]


def test_without_truth_and_optimum(run: tuple[Truth, Recording]):
    assert lines_of(None, run[1], "ekf") == [
        "empty: ATE [m], x optimum, NEES, in 95% ellipse, heading [rad], end [m], wrong, map [m], of, nats to optimum: "
        "the truth is not known (no truth.npz)",
        "empty: d to optimum: no optimum of their kind is there "
        "(causal for filtered estimates, batch for smoothed ones)",
        "empty: end to batch [m]: batch is not among the estimators that ran",
    ]


def test_of_a_path_alone(run: tuple[Truth, Recording]):
    nis = "empty: NIS/dof: no estimate has `nis` and `nis_dof`"
    assert lines_of(*run, "mine", "batch") == [nis]  # batch has the rest
    assert lines_of(replace(run[0], landmarks=None, landmark_ids=None), run[1], "mine") == [
        "empty: x optimum, d to optimum: no optimum of their kind is there "
        "(causal for filtered estimates, batch for smoothed ones)",
        "empty: NEES, in 95% ellipse, nats to optimum: no estimate has `pose_covs`",
        nis,
        "empty: wrong: no estimate has `association`",
        "empty: map [m]: truth.npz has no landmarks",
        "empty: end to batch [m]: batch is not among the estimators that ran",
    ]


def test_notes_stand_in_the_file_too_and_a_single_run_is_called_one(run: tuple[Truth, Recording]):
    found = compare_estimators(*run, load_estimators(["ekf"]))
    notes = metrics(found, None, None)["notes"]
    assert [note.partition(":")[0] for note in notes] == ["empty", "empty", "a single run"]
    assert all(note in str(table(found)).splitlines() for note in notes)
    without = compare_estimators(None, run[1], load_estimators(["ekf"]))
    assert "a single run" not in str(table(without))
