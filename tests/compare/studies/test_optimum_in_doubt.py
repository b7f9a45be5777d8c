"""Tables and figures over many runs do not let figures against an optimum stand that is none."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.figures.sweep_figure import save_sweep_figure
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.compare.studies.sweep import Sweep, sweep_table
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

EMPTY = "Empty columns: x hindsight (docs/your_filter.md lists what each needs)"
NOTE = (
    "causal is more than 0.05 sigma from the optimum at a checked step in 50.0% of the runs: "
    "figures relative to it are marked ?"
)


def studied(
    checks: list[float], scenario: Scenario, thread: ThreadPoolExecutor, out: Path, monkeypatch: pytest.MonkeyPatch
) -> Summary:
    """A study in which the causal optimum says of itself what `checks` has for each run."""
    causal = load_estimators(["causal"])["causal"]
    starts = [simulate(scenario, run_seed(0, run))[1].odometry[0, 0] for run in range(len(checks))]

    def checked(recording: Recording) -> Estimate:
        check = checks[starts.index(recording.odometry[0, 0])]
        return replace(causal(recording), chi_square=52.0, chi_square_dof=50, optimum_check=check)

    with monkeypatch.context() as patch:
        patch.setattr("slamgauge.graph_baseline.causal", checked)
        return run_study(scenario, len(checks), 0, ("ekf", "causal"), out, thread)


def marks(table: str) -> list[int]:
    """How many figures of each row are marked, the head and the lines below left out."""
    return [line.count("?") for line in table.splitlines() if re.match(r"\w+ +2 ", line)]


def test_the_share_of_runs_in_doubt_stands_under_the_table(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sure = studied([0.01, 0.05], scenario, thread, tmp_path / "sure", monkeypatch)
    doubtful = studied([0.01, 0.31], scenario, thread, tmp_path / "doubtful", monkeypatch)
    assert [each.estimators["causal"].optimum_check_share for each in (sure, doubtful)] == [0.0, 0.5]
    assert doubtful.to_json()["estimators"]["causal"]["optimum_check_share"] == 0.5
    assert doubtful.to_json()["estimators"]["ekf"]["optimum_check_share"] is None
    fit = "fit of the model: chi2/dof of the causal optimum 1.040 ± 0.000"
    assert str(summary_table(sure)).splitlines()[3:5] == [fit, EMPTY]
    assert marks(str(summary_table(sure))) == [0, 0]
    assert str(summary_table(doubtful)).splitlines()[3:6] == [fit, NOTE, EMPTY]
    assert marks(str(summary_table(doubtful))) == [3, 3]  # x causal, log score to causal, sigma / optimum
    sweep = Sweep("x", "a.b", 2, 0, ("1", "7"), (sure, doubtful))
    lines = str(sweep_table(sweep)).splitlines()
    assert lines[5] == f"a.b=7: {NOTE}"
    assert [line.count("?") for line in lines[1:5]] == [0, 0, 1, 1]
    assert len({len(line) for line in lines[:5]}) == 1


def test_figures_say_it_too(
    scenario: Scenario,
    thread: ThreadPoolExecutor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    saved: dict[str, Figure],
) -> None:
    summaries = []
    for name, check in (("sure", 0.01), ("doubtful", 0.31)):
        summary = studied([0.01, check], scenario, thread, tmp_path / name, monkeypatch)
        runs = load_runs(scenario, 2, 0, ("ekf", "causal"), tmp_path / name)
        for draw in study_drawings(summary, runs, 0.1).values():
            draw(tmp_path)
        saved[name] = saved["ratios"]
        summaries.append(summary)
    labels = [[tick.get_text() for tick in saved[name].axes[0].get_yticklabels()] for name in ("sure", "doubtful")]
    assert labels == [["ekf / causal"], ["ekf / causal?"]]
    assert [saved[name].get_suptitle().partition("\n")[2] for name in ("sure", "doubtful", "nees")] == ["", NOTE, ""]
    for values, said in (((0, 0), ""), ((0, 1), "a.b=2: "), ((1, 1), "a.b=1, a.b=2: ")):
        save_sweep_figure(tmp_path, Sweep("x", "a.b", 2, 0, ("1", "2"), tuple(summaries[value] for value in values)))
        line = said and said + NOTE.rpartition(": ")[0]
        assert saved["sweep"].get_suptitle().partition("\n")[2] == line
