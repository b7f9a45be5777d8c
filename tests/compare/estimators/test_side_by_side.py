"""Yardsticks where nobody knows the associations: they stand under those that an estimator has made."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.side_by_side import run_side_by_side, with_stand_ins
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(load_scenario("q2-long-dense", ["trajectory.duration=4"]), 0)[1]


def own(recording: Recording) -> Estimate:
    return replace(ekf_slam(recording), kind="filtered")


def test_the_first_that_associates_tells_the_optima(recording: Recording):
    estimators = load_estimators(["causal", "dead-reckoning", "riekf", "ekf", "batch"])
    ran = run_side_by_side(estimators, recording, recording)
    assert [*ran.estimates] == ["dead-reckoning", "riekf", "ekf", "causal@riekf", "batch@riekf"]
    assert ran.optima == {"filtered": "causal@riekf", "smoothed": "batch@riekf"}
    assert (ran.failures, ran.stand_ins) == ({}, ["causal@riekf", "batch@riekf"])
    told = load_estimators(["causal@riekf"])["causal@riekf"](recording)
    assert np.array_equal(ran.estimates["causal@riekf"].poses, told.poses)


def test_people_s_own_can_tell_them_too(recording: Recording):
    ran = run_side_by_side({"mine": own, **load_estimators(["causal"])}, recording, recording)
    assert ran.optima == {"filtered": "causal@mine"}


def test_what_was_asked_for_as_such_is_the_optimum(recording: Recording):
    ran = run_side_by_side(load_estimators(["ekf", "causal@riekf", "robust-batch@ekf"]), recording, recording)
    assert ran.optima == {"filtered": "causal@riekf"}
    twice = run_side_by_side(load_estimators(["ekf", "causal", "causal@ekf"]), recording, recording)
    assert (twice.optima, [*twice.estimates]) == ({"filtered": "causal@ekf"}, ["ekf", "causal@ekf"])


def test_where_nobody_associates_they_fail_as_rows(recording: Recording):
    ran = run_side_by_side(load_estimators(["dead-reckoning", "batch"]), recording, recording)
    assert ([*ran.estimates], ran.stand_ins) == (["dead-reckoning"], [])
    assert "needs known association" in ran.failures["batch"]


def test_true_associations_are_told_as_ever(recording: Recording):
    truth = simulate(load_scenario("q2-long-dense", ["trajectory.duration=4"]), 0)[0]
    assert truth.association is not None
    informed = recording.associated(truth.association)
    ran = run_side_by_side(load_estimators(["ekf", "causal", "causal@ekf"]), recording, informed)
    assert (ran.optima, ran.stand_ins) == ({"filtered": "causal"}, [])


def test_evaluate_says_so_and_writes_what_it_has(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    save(tmp_path / "recording.npz", recording)
    words = ["evaluate", str(tmp_path / "recording.npz"), "--estimators", "ekf,causal,batch"]
    for _ in range(2):  # what it has written there it may replace
        assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "compared with causal@ekf and batch@ekf, with associations right or wrong" in capsys.readouterr().out
    entries = json.loads((tmp_path / "out/metrics.json").read_text())["estimators"]
    assert [*entries] == ["ekf", "causal@ekf", "batch@ekf"]
    assert entries["ekf"]["mahalanobis_to_optimum"] > 0
    assert {path.stem for path in (tmp_path / "out/estimates").iterdir()} == {*entries}
    assert {*entries} < with_stand_ins(["ekf", "causal", "batch"])


def test_a_recording_that_batch_refuses_leaves_the_others(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def refuses(*_: object, **__: object) -> Estimate:
        from slamgauge.errors import UserError

        raise UserError("motion 3: undetermined")

    monkeypatch.setattr("slamgauge.graph_baseline.batch", refuses)
    save(tmp_path / "recording.npz", recording)
    assert main(["evaluate", str(tmp_path / "recording.npz"), "--estimators", "ekf,causal,batch"]) == 1
    out = capsys.readouterr().out
    assert re.search(r"^batch@ekf +failed", out, re.MULTILINE)
    assert "estimator batch@ekf: motion 3: undetermined" in out
    assert "compared with causal@ekf, with" in out
