"""Bounds in studies: rows, columns, files and figures; everywhere else they are refused in one line."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.studies.stopping_rule import pairs_to_resolve
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import summary_table
from slamgauge.compare.studies.sweep import run_sweep, sweep_table
from slamgauge.errors import UserError
from slamgauge.graph_baseline import causal_bound, hindsight_bound

NAMES = ("ekf", "batch", "bound")
SHORT = ["start=sampled", "trajectory.duration=4"]


def test_ratios_to_the_bound_are_those_of_the_runs(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    misled = scenario.model_copy(update={"assumed": scenario.assumed.model_copy(update={"scale": 4.0})})
    content = run_study(misled, 5, 3, NAMES, tmp_path, thread).to_json()
    squares: dict[str, list[np.ndarray]] = {"causal": [], "hindsight": []}
    for run in range(5):
        truth, told = simulate(informed(misled), run_seed(3, run))
        for kind, bound in (("causal", causal_bound), ("hindsight", hindsight_bound)):
            squares[kind].append(np.trace(bound(truth, told)[:, :2, :2], axis1=1, axis2=2))
    rmse = {kind: np.sqrt(np.mean(each, axis=0)).mean() for kind, each in squares.items()}
    for name, kind in (
        ("ekf", "causal"),
        ("batch", "hindsight"),
        ("bound", "causal"),
        ("hindsight-bound", "hindsight"),
    ):
        entry = content["estimators"][name]
        ratio = entry["position_rmse_m"]["mean"] / rmse[kind]
        assert entry["ratio_to_bound"]["mean"] == pytest.approx(ratio, rel=1e-6)
        assert content["bound"][f"{kind}_position_rmse_m"] == pytest.approx(rmse[kind], rel=1e-6)
    assert content["estimators"]["bound"]["ratio_to_bound"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert not content["failures"]
    json.dumps(content, allow_nan=False)


def test_columns_rows_and_lines_of_bounds_stand_where_they_were_asked_for(
    scenario: Scenario, thread: ThreadPoolExecutor, saved: dict[str, Figure], tmp_path: Path
) -> None:
    summary = run_study(scenario, 2, 0, NAMES, tmp_path, thread)
    text = str(summary_table(summary))
    assert "RMSE [m]" in text
    assert "x bound" in text
    write_study(tmp_path, summary, load_runs(scenario, 2, 0, NAMES, tmp_path), 0.1)
    lines = {str(line.get_label()): line for line in saved["rmse"].axes[0].lines}
    assert {*lines} == {"ekf", "batch", "bound", "hindsight-bound"}
    truth, told = simulate(scenario, run_seed(0, 0))
    first = np.sqrt(np.trace(causal_bound(truth, told)[0, :2, :2]))
    assert np.asarray(lines["bound"].get_ydata())[0] == pytest.approx(first, rel=1e-6)
    assert {axes.get_ylabel() for axes in saved["errors"].axes} - {""} == {"ekf", "batch"}
    without = run_study(scenario, 2, 0, ("ekf", "batch"), tmp_path, thread)
    assert "bound" not in without.to_json()
    assert "x bound" not in str(summary_table(without))
    assert "RMSE [m]" not in str(summary_table(without))


def test_values_of_a_sweep_share_their_bounds(thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    words = ("q1-long-dense", SHORT, "assumed.scale=1,4", 2, 0, ("ekf", "bound"), tmp_path, thread)
    sweep = run_sweep(*words)
    once, again = (each.to_json()["bound"] for each in sweep.summaries)
    assert once == again
    assert len([*(tmp_path / "optimum").iterdir()]) == 1
    text = str(sweep_table(sweep))
    assert "x bound" in text
    assert "bound: nothing wrong" not in text


def test_either_bound_may_be_asked_for() -> None:
    assert [each.label for each in ask(["bound", "ekf"])] == ["bound", "hindsight-bound", "ekf"]
    assert [each.label for each in ask(["hindsight-bound"])] == ["hindsight-bound"]
    assert [each.label for each in ask(["hindsight-bound", "bound"])] == ["hindsight-bound", "bound"]
    with pytest.raises(UserError, match="bound is given twice"):
        ask(["bound", "bound"])


def test_precision_waits_for_no_ratio_of_a_bound() -> None:
    assert pairs_to_resolve(ask(["ekf", "bound", "causal"]), ()) == [("ekf", "causal")]


def test_a_single_run_has_no_bound(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["run", "q1-short-dense", "--estimators", "dead-reckoning,bound", "--set", "trajectory.duration=2"]
    assert main([*words, "--no-report", "--out", str(tmp_path / "out")]) == 1
    assert "bound: is a bound, which estimates nothing" in capsys.readouterr().out
