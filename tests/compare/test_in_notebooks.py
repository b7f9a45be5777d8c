"""What values show of themselves at a prompt and in a notebook, and what functions take there."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import slamgauge
import slamgauge.compare
from slamgauge import (
    Recording,
    Truth,
    UserError,
    compare_estimators,
    evaluate,
    load_estimators,
    load_runs,
    load_scenario,
    local_processes,
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
    with local_processes(1) as executor:
        summary = run_study(SHORT, 2, 0, ["ekf"], str(tmp_path_factory.mktemp("study")), executor)
    return {
        "Recording": recording,
        "Estimate": comparison.estimates["ekf"],
        "Score": comparison.scores["ekf"],
        "Comparison": comparison,
        "Summary": summary,
    }


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("Recording", "Recording(range-bearing, 10 steps, 1 s, "),
        ("Estimate", "Estimate(filtered, 11 poses with covariances, "),
        ("Score", "Score(filtered, ATE 0."),
        ("Comparison", "Comparison(ekf, batch)"),
        ("Summary", "Summary(q1-short-dense, 2 runs: ekf)"),
    ],
)
def test_values_are_a_line_at_the_prompt_and_a_table_in_notebooks(shown: dict[str, Any], name: str, start: str):
    assert repr(shown[name]).startswith(start)
    assert len(repr(shown[name])) < 100
    assert shown[name]._repr_html_().startswith('<div style="overflow-x: auto"><table>')


def test_values_become_data_frames(shown: dict[str, Any]):
    recording, comparison, summary = shown["Recording"], shown["Comparison"], shown["Summary"]
    frame = recording.to_frame()
    assert list(frame) == ["step", "stamp", "landmark", "range", "bearing"]
    np.testing.assert_array_equal(frame["bearing"], recording.observation[:, 1])
    path = shown["Estimate"].to_frame()
    assert list(path) == ["x", "y", "heading", "sigma_x", "sigma_y", "sigma_heading"]
    np.testing.assert_allclose(path["sigma_y"] ** 2, shown["Estimate"].pose_covs[:, 1, 1], rtol=1e-12)
    assert comparison.to_frame().loc["batch", "ate_m"] == comparison.scores["batch"]["ate_m"]
    assert shown["Score"].to_frame().loc["nees_pose", "value"] == comparison.scores["ekf"]["nees_pose"]
    assert summary.to_frame().loc["ekf", "ate_m_low"] == summary.estimators["ekf"]["ate_m"].low


def test_without_pandas_it_is_named(shown: dict[str, Any], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UserError, match="to_frame: needs pandas; pip install pandas"):
        shown["Recording"].to_frame()


def test_a_scenario_may_be_given_by_its_name(tmp_path: Path):
    by_name = simulate("q1-short-dense", 3)
    assert by_name == simulate(load_scenario("q1-short-dense"), 3)
    with pytest.raises(UserError, match="did you mean q1-short-dense"):
        simulate("q1-short-dens", 3)
    with local_processes(1) as executor:
        assert run_study("q1-short-dense", 1, 0, ["dead-reckoning"], tmp_path, executor).runs == 1


def test_one_covariance_stands_for_all_rows(shown: dict[str, Any]):
    recording: Recording = shown["Recording"]
    motion, sight = np.diag([0.1, 0.0, 0.2]), np.diag([0.3, 0.4])
    short = replace(recording, odometry_cov=motion, observation_cov=sight)
    long = replace(
        recording,
        odometry_cov=np.tile(motion, (recording.steps, 1, 1)),
        observation_cov=np.tile(sight, (len(recording.observation), 1, 1)),
    )
    assert short == long
    with pytest.raises(UserError, match=r"odometry_cov: not an array of numbers"):
        replace(recording, odometry_cov=[[1.0], [2.0, 3.0]])  # pyrefly: ignore[bad-argument-type]


def test_arguments_of_another_type_are_named(shown: dict[str, Any]):
    recording: Any = shown["Recording"]
    with pytest.raises(UserError, match="truth: is a Recording; give a Truth"):
        evaluate(recording, recording, shown["Estimate"])
    with pytest.raises(UserError, match="seed: '0' is not valid; use a whole number"):
        simulate(SHORT, "0")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(UserError, match="estimate: is a str; give an Estimate"):
        evaluate(None, simulate(SHORT, 0)[1], "ekf")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(UserError, match="recording: is a Truth; give a Recording"):
        compare_estimators(None, Truth(), {})  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(UserError, match="estimators: is a list; give a Mapping"):
        compare_estimators(None, recording, ["ekf"])  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(UserError, match="estimators: 'ekf' is one text; give a list of names, or a dict by labels"):
        load_estimators("ekf")


@pytest.mark.parametrize("name", [*REGISTRY])
def test_a_recording_of_another_type_is_named(name: str):
    estimator = load_estimators([name])[name]
    with pytest.raises(UserError, match="recording: is a str; give a Recording"):
        estimator("q1-long-dense")  # pyrefly: ignore[bad-argument-type]


def test_the_floor_of_comparisons_lists_its_names():
    names = dir(slamgauge.compare)
    assert {"Comparison", "run_study", "load_scenario"} <= {*names}
    assert "SlamFilter" not in names
    assert slamgauge.compare.run_study is run_study


def takes_a_path(out: object, *_: object) -> bool:
    return isinstance(out, Path)


def test_folders_may_be_told_as_texts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("slamgauge.compare.figures.publishing.decorate", takes_a_path)
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(SHORT, 2, 0, ["ekf"], str(tmp_path / "study"), executor)
        sweep = run_sweep(
            "q1-short-dense",
            ["trajectory.duration=1"],
            "assumed.scale=1,2",
            *(1, 0, ["ekf"], str(tmp_path / "sweep"), executor),
        )
    runs = load_runs(SHORT, 2, 0, ["ekf"], str(tmp_path / "study"))
    assert write_study(str(tmp_path / "study"), summary, runs, 0.1)
    assert len(sweep.summaries) == 2
    truth, recording = simulate(SHORT, 0)
    save_figure(str(tmp_path), truth, recording, {"ekf": ekf_slam(recording)}, "a run")
    assert (tmp_path / "figure.svg").exists()
