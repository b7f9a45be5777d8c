"""Optima if the true associations are unknown: they use the associations of an estimator."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.running import run_side_by_side
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

pytestmark = pytest.mark.slow

SCENARIO = load_scenario("q2-long-dense", ["trajectory.duration=4"])


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(SCENARIO, 0)[1]


def own(recording: Recording) -> Estimate:
    return replace(ekf_slam(recording), kind="filtered")


def test_the_optima_use_the_associations_of_the_first_estimator(recording: Recording):
    estimators = load_estimators(["causal", "dead-reckoning", "riekf", "ekf", "batch"])
    ran = run_side_by_side(estimators, recording, recording)
    assert [*ran.estimates] == ["dead-reckoning", "riekf", "ekf", "causal@riekf", "batch@riekf"]
    assert ran.optima == {"filtered": "causal@riekf", "smoothed": "batch@riekf"}
    assert (ran.failures, ran.stand_ins) == ({}, ["causal@riekf", "batch@riekf"])
    told = load_estimators(["causal@riekf"])["causal@riekf"](recording)
    assert np.array_equal(ran.estimates["causal@riekf"].poses, told.poses)


def test_the_first_estimator_may_be_a_user_callable(recording: Recording):
    ran = run_side_by_side({"mine": own, **load_estimators(["causal"])}, recording, recording)
    assert ran.optima == {"filtered": "causal@mine"}


def test_a_requested_graph_with_associations_is_the_optimum(recording: Recording):
    ran = run_side_by_side(load_estimators(["ekf", "causal@riekf", "robust-batch@ekf"]), recording, recording)
    assert ran.optima == {"filtered": "causal@riekf"}
    twice = run_side_by_side(load_estimators(["ekf", "causal", "causal@ekf"]), recording, recording)
    assert (twice.optima, [*twice.estimates]) == ({"filtered": "causal@ekf"}, ["ekf", "causal@ekf"])


def test_without_any_associations_the_optima_fail(recording: Recording):
    ran = run_side_by_side(load_estimators(["dead-reckoning", "batch"]), recording, recording)
    assert ([*ran.estimates], ran.stand_ins) == (["dead-reckoning"], [])
    assert "needs known association" in ran.failures["batch"]


def test_true_associations_are_used_if_known(recording: Recording):
    truth = simulate(SCENARIO, 0)[0]
    assert truth.association is not None
    informed = recording.associated(truth.association)
    ran = run_side_by_side(load_estimators(["ekf", "causal", "causal@ekf"]), recording, informed)
    assert (ran.optima, ran.stand_ins) == ({"filtered": "causal"}, [])


def test_evaluate_reports_the_associations_and_writes_the_estimates(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    save(tmp_path / "recording.npz", recording)
    words = ["evaluate", str(tmp_path / "recording.npz"), "--estimators", "ekf,causal,batch"]
    for _ in range(2):  # it may replace its own files
        assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert "compared with causal@ekf and batch@ekf, with associations right or wrong" in capsys.readouterr().out
    entries = json.loads((tmp_path / "out/metrics.json").read_text())["estimators"]
    assert [*entries] == ["ekf", "causal@ekf", "batch@ekf"]
    assert entries["ekf"]["mahalanobis_to_optimum"] > 0
    assert {path.stem for path in (tmp_path / "out/estimates").iterdir()} == {*entries}


def test_a_failure_of_batch_leaves_other_results(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def refuses(*_: object, **__: object) -> Estimate:
        raise UserError("motion 3: undetermined")

    monkeypatch.setattr("slamgauge.graph_baseline.batch", refuses)
    save(tmp_path / "recording.npz", recording)
    assert main(["evaluate", str(tmp_path / "recording.npz"), "--estimators", "ekf,causal,batch"]) == 1
    out = capsys.readouterr().out
    assert re.search(r"^batch@ekf +failed", out, re.MULTILINE)
    assert "estimator batch@ekf: motion 3: undetermined" in out
    assert "compared with causal@ekf, with" in out
