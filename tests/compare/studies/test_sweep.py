"""Sweeps, bounds and optima: one optimum for all values with the same measurements, and marks of optima in doubt."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.figures.result_figures import save_sweep_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import EstimatorSummary, Summary, summary_table
from slamgauge.compare.studies.sweep import Sweep, run_sweep, sweep_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import causal_bound, hindsight_bound
from slamgauge.recording import Recording

pytestmark = pytest.mark.slow

SHORT = ["start=sampled", "trajectory.duration=3"]
BOTH = ("ekf", "causal")
Swept = Callable[..., Sweep]
Run = Callable[..., Summary]


@pytest.fixture
def swept(thread: ThreadPoolExecutor, tmp_path: Path) -> Swept:
    def swept(scenario: str, sweep: str, runs: int, names: tuple[str, ...] = BOTH, seed: int = 0) -> Sweep:
        return run_sweep(scenario, SHORT, sweep, runs, seed, names, tmp_path, thread)

    return swept


def test_every_point_is_the_study_of_its_scenario_and_the_optimum_runs_once(swept: Swept, run: Run, tmp_path: Path):
    sweep = swept("q2-long-dense", "association.gate = 1, 9", 3, seed=5)
    assert sweep.values == ("1", "9")
    for value, summary in zip(sweep.values, sweep.summaries, strict=True):
        scenario = load_scenario("q2-long-dense", [*SHORT, f"association.gate={value}"])
        alone = run(3, BOTH, value, seed=5, scenario=scenario)
        for name in BOTH:
            one, other = summary.estimators[name], alone.estimators[name]
            assert (one["ate_m"], one["landmarks_mapped"]) == (other["ate_m"], other["landmarks_mapped"])
        assert summary.estimators["ekf"]["ratio_to_causal"] == alone.estimators["ekf"]["ratio_to_causal"]
    assert len(list((tmp_path / "optimum").iterdir())) == 1
    assert sweep.summaries[0].estimators["causal"]["ate_m"] == sweep.summaries[1].estimators["causal"]["ate_m"]
    mapped = [summary.estimators["ekf"]["landmarks_mapped"] for summary in sweep.summaries]
    assert mapped[0].mean > 2 * mapped[1].mean


def test_a_key_that_changes_the_measurements_has_an_optimum_at_each_value(swept: Swept, tmp_path: Path):
    sweep = swept("q1-long-dense", "sensor.sigma_range=0.01,1", 2)
    assert len(list((tmp_path / "optimum").iterdir())) == 2
    first, second = (summary.estimators["causal"]["ate_m"].mean for summary in sweep.summaries)
    assert first < second


def test_more_values_later_run_no_optimum_again_and_failures_are_reported(
    swept: Swept, monkeypatch: pytest.MonkeyPatch
):
    broken = Mock(side_effect=UserError("broken on purpose"))
    swept("q2-long-dense", "association.gate=9,16", 2)
    monkeypatch.setattr("slamgauge.graph_baseline.causal", broken)
    monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
    again = swept("q2-long-dense", "association.gate=4,9", 2)
    assert again.summaries[0].estimators["causal"]["runs"] == 2
    assert [failure.run for failure in again.summaries[0].failures] == [0, 1]
    assert again.summaries[1].failures == ()
    lines = str(sweep_table(again)).splitlines()
    assert lines[-1] == "association.gate=4, run 1: ekf failed: estimator ekf: broken on purpose"


@pytest.mark.parametrize(
    ("sweep", "name", "message"),
    [
        ("prior.mean=[0,0,0],[1,0,0]", "ekf", "cannot be swept; write a scenario file for each"),
        ("association.gate= , ", "ekf", r"write key=v1,v2,\.\.\."),
        ("association.gate=1,2,1", "ekf", "name each once"),
        ("association.gate=9,-1", "ekf", "choose it above 0"),
        ("association.gate=9,9.0", "ekf", r"9 and 9\.0 are the same value"),
        ("association.gate=9", "causal", "add a filter"),
    ],
)
def test_mistakes_are_found_before_anything_is_run(swept: Swept, tmp_path: Path, sweep: str, name: str, message: str):
    with pytest.raises(UserError, match=message):
        swept("q2-long-dense", sweep, 1, (name,))
    assert not list(tmp_path.iterdir())


def entry(summary: Summary, *faults: str, runs: int = 7) -> EstimatorSummary:
    return EstimatorSummary({**summary.estimators["ekf"], "runs": runs, "faults": faults})


def test_faults_are_below_the_table_with_their_values(swept: Swept):
    """They are those of the verdicts, without sizes, which the table has."""
    sweep = swept("q2-long-dense", "association.gate=1,4,9", 2, ("ekf",))
    small, loses = "claims too small a sigma", "worse than the causal optimum"
    faults = {
        "ekf": ((small, loses), (small,), (small,)),
        "mine": ((), (), ("claims too large a sigma",)),
        "right": ((), (), ()),
    }
    summaries = tuple(
        replace(each, estimators={name: entry(each, *found[place]) for name, found in faults.items()})
        for place, each in enumerate(sweep.summaries)
    )
    assert str(sweep_table(replace(sweep, runs=7, summaries=summaries))).splitlines()[-3:] == [
        "ekf: claims too small a sigma at every value; worse than the causal optimum at association.gate=1",
        "mine: claims too large a sigma at association.gate=9",
        "right: nothing wrong is shown by 7 runs",
    ]
    failed = tuple(replace(each, estimators={"mine": entry(each, runs=0)}) for each in sweep.summaries)
    assert "mine:" not in str(sweep_table(replace(sweep, summaries=failed)))


def test_the_command_sweeps_user_code_with_the_built_in_estimators(
    tmp_path: Path, drawn: dict[str, Figure], capsys: pytest.CaptureFixture[str]
):
    own = Path(__file__).parents[3] / "examples/student_ekf.py"
    arguments = ["study", "q3-scale-1", "--runs", "2", "--jobs", "1", "--set", "trajectory.duration=2"]
    arguments += ["--estimators", f"causal@ekf,ekf,mine={own}:ekf_slam,causal", "--out", str(tmp_path)]
    assert main([*arguments, "--sweep", "assumed.scale=0.1,10"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["assumed.scale", "estimator"]
    names = ("causal@ekf", "ekf", "mine", "causal")
    assert [line.split()[:2] for line in lines[1:9]] == [[value, name] for value in ("0.1", "10") for name in names]
    content = json.loads((tmp_path / "sweep.json").read_text())
    entries = [point["summary"]["estimators"]["ekf"] for point in content["points"]]
    expected = [["innovations larger than it expects"], ["innovations smaller than it expects"]]
    assert [each["faults"] for each in entries] == expected
    assert entries[1]["position_sigma_m"]["mean"] > entries[0]["position_sigma_m"]["mean"]
    assert drawn["sweep"].axes[0].get_legend_handles_labels()[1] == ["causal@ekf", "ekf", "mine", "causal optimum"]
    assert (tmp_path / "assumed.scale=0.1/summary.json").exists()


BOUNDED = ("ekf", "batch", "bound")


def test_ratios_to_the_bound_are_those_of_the_runs(scenario: Scenario, run: Run) -> None:
    misled = scenario.model_copy(update={"assumed": scenario.assumed.model_copy(update={"scale": 4.0})})
    content = run(5, BOUNDED, seed=3, scenario=misled).to_json()
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
    assert content["estimators"]["bound"]["ratio_to_bound"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert not content["failures"]
    json.dumps(content, allow_nan=False)


def test_columns_rows_and_lines_of_bounds_exist_if_they_are_requested(
    scenario: Scenario, run: Run, drawn: dict[str, Figure], tmp_path: Path
) -> None:
    summary = run(2, BOUNDED)
    without = run(2, ("ekf", "batch"))
    for title in ("RMSE [m]", "x bound"):
        assert title in str(summary_table(summary))
        assert title not in str(summary_table(without))
    write_study(tmp_path, summary, dict(summary.loaded), 0.1)
    lines = {str(line.get_label()): line for line in drawn["rmse"].axes[0].lines}
    assert {*lines} == {"ekf", "batch", "bound", "hindsight-bound"}
    first = np.sqrt(np.trace(causal_bound(*simulate(scenario, run_seed(0, 0)))[0, :2, :2]))
    assert np.asarray(lines["bound"].get_ydata())[0] == pytest.approx(first, rel=1e-6)
    assert {axes.get_ylabel() for axes in drawn["errors"].axes} - {""} == {"ekf", "batch"}


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


def test_optima_in_doubt_are_noted_and_marked_in_tables_and_figures(
    studied: Callable[[list[float], str], Summary], tmp_path: Path, drawn: dict[str, Figure]
) -> None:
    sure, doubtful = studied([0.01, 0.05], "sure"), studied([0.01, 0.31], "doubtful")
    entries = doubtful.to_json()["estimators"]
    assert [entries[name]["optimum_check_share"] for name in BOTH] == [None, 0.5]
    fit = "fit of the model: chi2/dof of the causal optimum 1.040 ± 0.000"
    for summary, notes in ((sure, []), (doubtful, [NOTE])):
        lines, count = str(summary_table(summary)).splitlines(), len(notes)
        assert [line.count("?") for line in lines[1:3]] == [count, count]  # x causal
        assert [line for line in lines if line in (fit, NOTE)] == [fit, *notes]
        study_drawings(summary, dict(summary.loaded), 0.1)["ratios"](tmp_path)
        assert [tick.get_text() for tick in drawn["ratios"].axes[0].get_yticklabels()] == ["ekf / causal" + "?" * count]
        assert drawn["ratios"].get_suptitle().partition("\n")[2] == fill("".join(notes), WIDTH)
    sweep = Sweep("x", "a.b", 2, 0, ("1", "7"), (sure, doubtful))
    lines = str(sweep_table(sweep)).splitlines()
    assert lines[5] == f"a.b=7: {NOTE}"
    assert [line.count("?") for line in lines[1:5]] == [0, 0, 1, 1]
    assert len({len(line) for line in lines[:5]}) == 1
    save_sweep_figure(tmp_path, sweep)
    assert drawn["sweep"].get_suptitle().partition("\n")[2] == fill(lines[5].rpartition(": ")[0], WIDTH)
