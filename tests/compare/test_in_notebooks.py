"""What values show of themselves at a prompt and in a notebook, and what functions take there."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import slamgauge
import slamgauge.compare
from slamgauge import (
    Truth,
    UserError,
    compare_estimators,
    evaluate,
    load_estimators,
    load_runs,
    load_scenario,
    run_study,
    run_sweep,
    save_figure,
    simulate,
    write_study,
)
from slamgauge.compare.estimators.registry import REGISTRY
from slamgauge.ekf import ekf_slam

SHORT = load_scenario("q1-short-dense", ["trajectory.duration=1"])


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    truth, recording = simulate(SHORT, 0)
    comparison = compare_estimators(truth, recording, load_estimators(["ekf", "batch"]))
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(SHORT, 2, 0, ["ekf"], str(tmp_path_factory.mktemp("study")), executor)
    return {
        "Recording(range-bearing, 10 steps, 1 s, ": recording,
        "Estimate(filtered, 11 poses with covariances, ": comparison.estimates["ekf"],
        "Score(filtered, ATE [m] 0.": comparison.scores["ekf"],
        "Comparison(ekf, batch)": comparison,
        "Summary(q1-short-dense, 2 runs: ekf)": summary,
    }


def test_values_are_a_line_at_the_prompt_and_a_table_in_notebooks(shown: dict[str, Any]):
    for start, value in shown.items():
        assert repr(value).startswith(start)
        assert len(repr(value)) < 100
        if not isinstance(value, slamgauge.Recording | slamgauge.Estimate):
            assert value._repr_html_().startswith('<div style="overflow-x: auto; white-space: nowrap"><table>')


def test_one_covariance_stands_for_all_rows():
    recording, motion, sight = simulate(SHORT, 0)[1], np.diag([0.1, 0.0, 0.2]), np.diag([0.3, 0.4])
    short = replace(recording, odometry_cov=motion, observation_cov=sight)
    motions = np.tile(motion, (recording.steps, 1, 1))
    sights = np.tile(sight, (len(recording.observation), 1, 1))
    assert short == replace(recording, odometry_cov=motions, observation_cov=sights)
    with pytest.raises(UserError, match=r"odometry_cov: not an array of numbers"):
        replace(recording, odometry_cov=[[1.0], [2.0, 3.0]])  # pyrefly: ignore[bad-argument-type]


def test_arguments_of_another_type_are_named():
    recording: Any = simulate(SHORT, 0)[1]
    text: Any = "ekf"
    for call, message in (
        (lambda: evaluate(recording, recording, ekf_slam(recording)), "truth: is of type Recording; give type Truth"),
        (lambda: evaluate(None, recording, text), "estimate: is of type str; give type Estimate"),
        (lambda: simulate("q1-short-dens", 3), "did you mean q1-short-dense"),
        (lambda: simulate(SHORT, text), "seed: 'ekf' is not valid; use a whole number"),
        (lambda: compare_estimators(None, Truth(), {}), "recording: is of type Truth;"),  # pyrefly: ignore
        (lambda: compare_estimators(None, recording, [text]), "estimators: is of type list; give"),  # pyrefly: ignore
        (lambda: load_estimators(text), "estimators: 'ekf' is one text; give a list of names, or a dict by labels"),
        *(((lambda name=name: load_estimators([name])[name](text)), "recording: is of type str") for name in REGISTRY),
    ):
        with pytest.raises(UserError, match=message):
            call()


def test_scenarios_and_folders_may_be_texts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("slamgauge.compare.figures.publishing.decorate", lambda out, *_: isinstance(out, Path))
    assert simulate("q1-short-dense", 3) == simulate(load_scenario("q1-short-dense"), 3)
    study, overrides = str(tmp_path / "study"), ["trajectory.duration=1"]
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(SHORT, 2, 0, ["ekf"], study, executor)
        where = (1, 0, ["ekf"], str(tmp_path / "sweep"), executor)
        sweep = run_sweep("q1-short-dense", overrides, "assumed.scale=1,2", *where)
    assert write_study(study, summary, load_runs(SHORT, 2, 0, ["ekf"], study), 0.1)
    assert len(sweep.summaries) == 2
    truth, recording = simulate(SHORT, 0)
    save_figure(str(tmp_path), truth, recording, {"ekf": ekf_slam(recording)}, "a run")
    assert (tmp_path / "figure.svg").exists()
