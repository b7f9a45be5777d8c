"""Bounds and optima in studies: rows, columns and figures; figures relative to an optimum in doubt are marked."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from textwrap import fill

import numpy as np
import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.figures.result_figures import save_sweep_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.compare.studies.sweep import Sweep, sweep_table
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import causal_bound, hindsight_bound
from slamgauge.recording import Recording

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]
NAMES = ("ekf", "batch", "bound")


def test_ratios_to_the_bound_are_those_of_the_runs(scenario: Scenario, run: Run) -> None:
    misled = scenario.model_copy(update={"assumed": scenario.assumed.model_copy(update={"scale": 4.0})})
    content = run(5, NAMES, seed=3, scenario=misled).to_json()
    squares: dict[str, list[np.ndarray]] = {"causal": [], "hindsight": []}
    for number in range(5):
        truth, exact = simulate(informed(misled), run_seed(3, number))
        for kind, bound in (("causal", causal_bound), ("hindsight", hindsight_bound)):
            squares[kind].append(np.trace(bound(truth, exact)[:, :2, :2], axis1=1, axis2=2))
    rmse = {kind: np.sqrt(np.mean(each, axis=0)).mean() for kind, each in squares.items()}
    kinds = {"ekf": "causal", "batch": "hindsight", "bound": "causal", "hindsight-bound": "hindsight"}
    for name, kind in kinds.items():
        entry = content["estimators"][name]
        ratio = entry["position_rmse_m"]["mean"] / rmse[kind]
        assert entry["ratio_to_bound"]["mean"] == pytest.approx(ratio, rel=1e-6)
        assert content["bound"][f"{kind}_position_rmse_m"] == pytest.approx(rmse[kind], rel=1e-6)
    assert content["estimators"]["bound"]["ratio_to_bound"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert not content["failures"]
    json.dumps(content, allow_nan=False)


def test_columns_rows_and_lines_of_bounds_exist_if_they_are_requested(
    scenario: Scenario, run: Run, drawn: dict[str, Figure], tmp_path: Path
) -> None:
    summary = run(2, NAMES)
    without = run(2, ("ekf", "batch"))
    for title in ("RMSE [m]", "x bound"):
        assert title in str(summary_table(summary))
        assert title not in str(summary_table(without))
    assert "bound" not in without.to_json()
    write_study(tmp_path, summary, dict(summary.loaded), 0.1)
    lines = {str(line.get_label()): line for line in drawn["rmse"].axes[0].lines}
    assert {*lines} == {"ekf", "batch", "bound", "hindsight-bound"}
    first = np.sqrt(np.trace(causal_bound(*simulate(scenario, run_seed(0, 0)))[0, :2, :2]))
    assert np.asarray(lines["bound"].get_ydata())[0] == pytest.approx(first, rel=1e-6)
    assert {axes.get_ylabel() for axes in drawn["errors"].axes} - {""} == {"ekf", "batch"}


def test_a_single_run_has_no_bound(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["run", "q1-short-dense", "--estimators", "dead-reckoning,bound", "--set", "trajectory.duration=2"]
    assert main([*words, "--no-report", "--out", str(tmp_path / "out")]) == 1
    assert "bound: is a bound, which estimates nothing" in capsys.readouterr().out


WIDTH = 91  # characters of a line in a figure of 7 in
NOTE = (
    "causal is more than 0.05 sigma from the optimum at a checked step in 50.0% of the runs: "
    "figures relative to it are marked ?"
)


@pytest.fixture
def studied(scenario: Scenario, run: Run, monkeypatch: pytest.MonkeyPatch) -> Callable[[list[float], str], Summary]:
    """A study in which the causal optimum returns these checks, one for each run."""
    causal = load_estimators(["causal"])["causal"]

    def studied(checks: list[float], where: str) -> Summary:
        starts = [simulate(scenario, run_seed(0, number))[1].odometry[0, 0] for number in range(len(checks))]

        def checked(recording: Recording) -> Estimate:
            check = checks[starts.index(recording.odometry[0, 0])]
            return replace(causal(recording), chi_square=52.0, chi_square_dof=50, optimum_check=check)

        with monkeypatch.context() as patch:
            patch.setattr("slamgauge.graph_baseline.causal", checked)
            return run(len(checks), ("ekf", "causal"), where)

    return studied


def marks(table: str) -> list[int]:
    """Return the number of marked figures in each row."""
    return [line.count("?") for line in table.splitlines() if re.match(r"\w+ +2 ", line)]


def test_the_share_of_runs_in_doubt_is_below_the_table(studied: Callable[..., Summary]) -> None:
    sure, doubtful = studied([0.01, 0.05], "sure"), studied([0.01, 0.31], "doubtful")
    assert [each.estimators["causal"]["optimum_check_share"] for each in (sure, doubtful)] == [0.0, 0.5]
    assert doubtful.to_json()["estimators"]["causal"]["optimum_check_share"] == 0.5
    assert doubtful.to_json()["estimators"]["ekf"]["optimum_check_share"] is None
    fit = "fit of the model: chi2/dof of the causal optimum 1.040 ± 0.000"
    assert str(summary_table(sure)).splitlines()[3] == fit
    assert marks(str(summary_table(sure))) == [0, 0]
    assert str(summary_table(doubtful)).splitlines()[3:5] == [fit, NOTE]
    assert marks(str(summary_table(doubtful))) == [1, 1]  # x causal
    sweep = Sweep("x", "a.b", 2, 0, ("1", "7"), (sure, doubtful))
    lines = str(sweep_table(sweep)).splitlines()
    assert lines[5] == f"a.b=7: {NOTE}"
    assert [line.count("?") for line in lines[1:5]] == [0, 0, 1, 1]
    assert len({len(line) for line in lines[:5]}) == 1


def test_figures_have_the_same_marks_and_notes(
    studied: Callable[[list[float], str], Summary], tmp_path: Path, drawn: dict[str, Figure]
) -> None:
    sure, doubtful = studied([0.01, 0.01], "sure"), studied([0.01, 0.31], "doubtful")
    for summary, label, note in ((sure, "ekf / causal", ""), (doubtful, "ekf / causal?", fill(NOTE, WIDTH))):
        for draw in study_drawings(summary, dict(summary.loaded), 0.1).values():
            draw(tmp_path)
        assert [tick.get_text() for tick in drawn["ratios"].axes[0].get_yticklabels()] == [label]
        assert drawn["ratios"].get_suptitle().partition("\n")[2] == note
    save_sweep_figure(tmp_path, Sweep("x", "a.b", 2, 0, ("1", "2"), (sure, doubtful)))
    line = f"a.b=2: {NOTE.rpartition(': ')[0]}"
    assert drawn["sweep"].get_suptitle().partition("\n")[2] == fill(line, WIDTH)
