"""The JSON that commands print and write agrees with its schema, and the schemas with the catalogue of metrics."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from slamgauge import compare_estimators, find_noise, load_estimators, load_scenario, simulate
from slamgauge.compare.checks.examination import check_estimator, verdicts_json
from slamgauge.compare.cli.listings import Kind
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.requests import Asked, Isolation
from slamgauge.compare.grading.grades import grade
from slamgauge.compare.grading.grading import Grades, GradeSettings
from slamgauge.compare.grading.rubric import load_rubric
from slamgauge.compare.grading.trial import Trial
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.scoring.catalogue import CATALOGUE
from slamgauge.compare.scoring.comparison import Comparison, metrics
from slamgauge.compare.studies.budget import RUNGS, summarise_budget
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.sweep import Sweep
from slamgauge.ekf import ekf_slam
from tests.reference.json_schemas import FOLDER, SCHEMAS, complaints, held

SHORT = ["trajectory.duration=3", "start=sampled"]


def of(content: object) -> Any:
    """Return the content after writing and reading it as JSON."""
    return json.loads(json.dumps(content, allow_nan=False))


@pytest.mark.parametrize("kind", get_args(Kind))
def test_the_command_prints_the_file(kind: str, capsys: pytest.CaptureFixture[str]):
    assert main(["schema", kind]) == 0
    assert (FOLDER / f"{kind}.json").read_text(encoding="utf-8") == capsys.readouterr().out


def test_the_command_offers_every_file():
    assert {*get_args(Kind)} == {*SCHEMAS}


@pytest.mark.parametrize("kind", ["metrics", "summary"])
def test_metrics_have_the_help_of_the_catalogue(kind: str):
    """Every metric of the catalogue is in the schema with its help and unit."""
    entry = SCHEMAS[kind]["properties"]["estimators"]["additionalProperties"]["properties"]
    found = {key: value.get("description") for key, value in entry.items() if key not in ("kind", "runs", "rays")}
    chosen = [each for each in CATALOGUE if (each.scored if kind == "metrics" else each.over_runs is not None)]
    assert found == {
        each.key: each.help + (f" [{each.unit}]" if each.unit else "")
        for each in chosen
        if each.key not in ("kind", "rays")
    }


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    truth, recording = simulate(load_scenario("q1-short-dense", [*SHORT, "trajectory.duration=12"]), 0)
    return compare_estimators(truth, recording, load_estimators(["dead-reckoning", "ekf", "causal", "batch"]))


def test_a_run(comparison: Comparison):
    found = of(metrics(comparison, "q1", 0, "x = 1"))
    held("metrics", found)
    assert found["estimators"]["ekf"]["rpe_by_distance"]
    assert found["estimators"]["ekf"]["verdict"] is None
    stored = metrics(compare_estimators(None, comparison.recording, load_estimators(["ekf"])), None, None)
    assert held("metrics", of(stored))["truth"] is False


def test_a_bearing_only_run():
    scenario = load_scenario("q4-ring", SHORT)
    found = of(metrics(compare_estimators(*simulate(scenario, 0), load_estimators(["riekf"])), "q4-ring", 0))
    assert held("metrics", found)["estimators"]["riekf"]["rays"]["members"] > 0


def test_studies_and_sweeps(tmp_path: Path):
    scenario = load_scenario("q1-short-dense", SHORT)
    with ThreadPoolExecutor(1) as executor:
        arguments = (scenario, 3, 0, ["ekf", "causal", "batch", "bound"], tmp_path, executor)
        summary = run_study(*arguments, against=["ekf"])
    found = held("summary", of(summary.to_json()))
    assert found["against"]["ekf"]["causal"]
    assert found["bound"]["causal_position_rmse_m"] > 0
    held("sweep", of(Sweep("q1", "a.b", 3, 0, ("1", "2"), (summary, summary)).to_json()))


def budget() -> Any:
    errors = np.random.default_rng(0).uniform(1.0, 2.0, (3, len(RUNGS)))
    return summarise_budget("q1", "ekf", errors, np.full(errors.shape, np.nan), np.ones(3)).to_json()


def grades() -> Any:
    rubric = load_rubric()
    failed = grade("one", Trial(reason="no file"), [], rubric)
    settings = GradeSettings(
        load_scenario("q1-long-dense"), 2, 0, Asked("ekf", "ekf"), Isolation(60.0, strict=False), rubric
    )
    return Grades(Path("class"), settings, failed, (failed,)).to_json()


def noise() -> Any:
    recording = simulate(load_scenario("q1-short-dense", [*SHORT, "trajectory.duration=5"]), 0)[1]
    return noise_json(find_noise(recording, systematic=True))


def check() -> Any:
    return verdicts_json(check_estimator("ekf", ekf_slam))


@pytest.mark.parametrize("make", [budget, grades, noise, check], ids=lambda make: make.__name__)
def test_other_results(make: Callable[[], Any]):
    held(make.__name__, of(make()))


@pytest.mark.parametrize("kind", ["scenarios", "doctor"])
def test_lists_of_other_commands(kind: str, capsys: pytest.CaptureFixture[str]):
    assert main([kind, "--json"]) == 0
    held(kind, json.loads(capsys.readouterr().out))


def test_unknown_missing_and_wrong_values_are_errors(comparison: Comparison):
    found = of(metrics(comparison, "q1", 0))
    entry = found["estimators"].pop("ekf")
    for wrong in ({**entry, "luck": 1.0}, {**entry, "ate_m": "0.3"}, {k: v for k, v in entry.items() if k != "ate_m"}):
        said = complaints("metrics", {**found, "estimators": {"ekf": wrong}})
        assert len(said) == 1
        assert "luck" in said[0] or "ate_m" in said[0] or "0.3" in said[0]
