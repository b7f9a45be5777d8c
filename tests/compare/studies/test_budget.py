"""The error budget: equal rungs cost nothing, increments add up, each cause is charged to its own rung."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import FIXED_LAG
from slamgauge.compare.figures.result_figures import save_budget_figure
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.studies.budget import (
    RUNGS,
    ErrorBudget,
    budget_table,
    error_budget,
    rung_errors,
    summarise_budget,
)
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow


def short(name: str = "q1-long-dense", *overrides: str, duration: float = 4) -> Scenario:
    return load_scenario(name, ["start=sampled", f"trajectory.duration={duration}", *overrides])


def of_table(
    rows: list[list[float]], checks: list[list[float]] | None = None, name: str = "here", fit: float = 1.0
) -> ErrorBudget:
    """Return the budget of mean squared errors, a row for each run, with the same fit in each."""
    table = np.array(rows)
    unchecked = np.full_like(table, np.nan)
    fits = np.full(len(rows), fit)
    return summarise_budget(name, "ekf", table, unchecked if checks is None else np.array(checks), fits)


def test_equal_rungs_cost_nothing_and_increments_add_up(thread: ThreadPoolExecutor) -> None:
    budget = error_budget(short(), "ekf", 4, 0, thread)
    assert [rung.name for rung in budget.rungs] == [name for name in RUNGS if name != FIXED_LAG]
    assert budget.rungs[2].increment_m2 == Interval(0.0, 0.0, 0.0)
    assert budget.rungs[3].increment_m2 == Interval(0.0, 0.0, 0.0)
    total = sum(rung.increment_m2.mean for rung in budget.rungs[1:])
    assert total == pytest.approx(budget.rungs[-1].mse_m2 - budget.rungs[0].mse_m2, rel=1e-12)
    errors = []
    for run in range(4):
        truth, recording = simulate(short(), run_seed(0, run))
        assert truth.poses is not None
        difference = load_estimators(["ekf"])["ekf"](recording).poses[:, :2] - truth.poses[:, :2]
        errors.append(np.square(difference).sum(axis=1).mean())
    assert budget.rungs[-1].mse_m2 == pytest.approx(np.mean(errors), rel=1e-12)


def test_wrong_noise_is_charged_to_the_noise() -> None:
    for seed in range(2):
        errors = rung_errors(short("q1-long-dense", "assumed.sensor_scale=0.01"), seed, "riekf")[0]
        np.testing.assert_array_equal(errors[:2], rung_errors(short(), seed, "riekf")[0][:2])
        assert errors[2] != errors[1]
        assert errors[3] == errors[2]


def test_a_filter_without_ids_pays_only_for_its_associations() -> None:
    """At gate 100, on measurements that the optimum receives with true noise and associations."""
    errors = rung_errors(short("q2-gate-100", duration=6), 2, "ekf")[0]
    np.testing.assert_array_equal(errors[:3], rung_errors(short(duration=6), 2, "ekf")[0][:3])
    assert errors[2] == errors[1]
    assert errors[3] > errors[2]
    assert errors[4] != errors[3]


@pytest.mark.gtsam
def test_a_lag_adds_a_rung_that_costs_nothing_with_a_window_of_all_steps(thread: ThreadPoolExecutor) -> None:
    scenario = short("q1-long-dense")
    steps = simulate(scenario, 0)[1].steps
    whole, brief = (rung_errors(scenario, 0, "riekf", lag)[0] for lag in (steps + 1, 2))
    assert len(whole) == len(RUNGS)
    assert whole[4] == pytest.approx(whole[3], rel=1e-3)
    assert brief[4] > 1.001 * brief[3]
    np.testing.assert_array_equal(np.delete(whole, 4), np.delete(brief, 4))
    assert [rung.name for rung in error_budget(scenario, "ekf", 1, 0, thread, lag=3).rungs] == list(RUNGS)
    with pytest.raises(UserError, match="lag: 0 steps leave no window"):
        error_budget(scenario, "ekf", 2, 0, thread, lag=0)


def test_the_costliest_rung_is_named_with_its_share_and_its_significance() -> None:
    budget = of_table([[1.0, 1.5, 1.5, 1.5, 4.0], [1.0, 2.0, 2.0, 2.0, 4.0]], name="somewhere")
    assert budget.costliest == "linearisation"
    assert budget.rungs[1].increment_m2.mean == 0.75
    assert max(map(len, budget_table(budget).text(80).splitlines())) <= 80
    assert str(budget_table(budget)).splitlines()[-1] == (
        "ekf on somewhere, 2 runs: mean squared error 4.0000 m^2 (RMS 2.000 m), 1.0000 m^2 of it unavoidable; "
        "the largest other part is linearisation: 2.2500 m^2, 56% of the total."
    )
    assert str(budget_table(of_table([[1.0] * 5]))).endswith("no other rung adds to it.")
    rows = [[1.0, 1.0, 1.0, 1.0, linearised] for linearised in (4.0, 0.5, 0.9)]
    for count, end in ((3, "44% of the total, not significantly above 0 in 3 runs."), (1, "above 0 in 1 run.")):
        assert str(budget_table(of_table(rows[:count]))).endswith(end)


def test_an_estimator_that_fails_is_named_with_the_seed(
    thread: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("slamgauge.ekf.ekf_slam", Mock(side_effect=UserError("broken on purpose")))
    with pytest.raises(ValueError, match=rf"^run with seed {run_seed(0, 0)}: estimator ekf: broken on purpose$"):
        error_budget(short(), "ekf", 2, 0, thread)


@pytest.mark.usefixtures("studies_in_a_thread")
def test_the_command_writes_table_json_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["budget", "q1-long-dense", "--set", "trajectory.duration=3", "--runs", "2", "--jobs", "1"]
    assert main([*words, "--out", str(tmp_path / "budget")]) == 0
    printed = capsys.readouterr().out
    content = json.loads((tmp_path / "budget" / "budget.json").read_text())
    keys = "version command scenario_text scenario filter runs seed digest rungs costliest verdict notes"
    assert set(content) == {*keys.split(), "chi_square_per_dof"}
    assert content["verdict"] in printed.splitlines()
    assert "unavoidable" in content["verdict"]
    assert set(content["rungs"][0]) == {"name", "mse_m2", "increment_m2", "optimum_check_share", "in_doubt"}
    assert (tmp_path / "budget" / "budget.png").stat().st_size > 0


def test_rungs_with_optima_in_doubt_are_marked_and_named(tmp_path: Path, drawn: dict[str, Figure]) -> None:
    rows = [[1.0, 1.5, 1.5, 2.0, 4.0], [1.0, 2.0, 2.0, 2.5, 4.0]]
    sure = [np.nan, 0.01, 0.01, 0.05, np.nan]
    budget = of_table(rows, [[np.nan, 0.01, 0.01, np.inf, np.nan], sure])
    assert str(budget_table(of_table(rows, [sure, sure]))).count("?") == 0
    lines = str(budget_table(budget)).splitlines()
    assert [line.count("?") for line in lines[:6]] == [0, 0, 0, 0, 1, 1]
    assert "linearisation: 1.7500? m^2, 44%? of the total." in lines[-2]
    note = (
        "own associations: causal is more than 0.05 sigma from the optimum at a checked step in 50.0% of the runs: "
        "figures relative to it are marked ?"
    )
    assert lines[-1] == note
    shares = [rung["optimum_check_share"] for rung in budget.to_json()["rungs"]]
    assert shares == [None, 0.0, 0.0, 0.5, None]
    save_budget_figure(tmp_path, budget)
    (axes,) = drawn["budget"].axes
    assert [text.get_text().count("?") for text in axes.texts] == [0, 0, 0, 1, 1, 0]
    assert note in " ".join(drawn["budget"].get_suptitle().split())


def test_optima_that_do_not_fit_the_stated_noise_are_marked() -> None:
    budget = of_table([[1.0, 1.5, 1.5, 2.0, 4.0]] * 3, fit=1.2)
    lines = str(budget_table(budget)).splitlines()
    assert "the residuals of batch and causal contradict the stated noise, so they are not optimal: " in "".join(lines)
    assert [line.count("?") for line in lines[:6]] == [0, 1, 1, 1, 1, 1]
    assert budget.to_json()["chi_square_per_dof"]["mean"] == pytest.approx(1.2)
