"""The error budget: rungs that coincide are zero, increments add up, associations are told from linearisation."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import FIXED_LAG
from slamgauge.compare.figures.budget_figure import save_budget_figure
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.studies.budget import RUNGS, budget_table, error_budget, rung_errors, rungs_of, summarise_budget
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.json_schemas import held

SHORT = ["start=sampled", "trajectory.duration=4"]


def test_rungs_that_coincide_are_zero_and_increments_add_up() -> None:
    with ThreadPoolExecutor(1) as executor:
        budget = error_budget(load_scenario("q1-long-dense", SHORT), "ekf", 4, 0, executor)
    assert [rung.name for rung in budget.rungs] == [name for name in RUNGS if name != FIXED_LAG]
    assert budget.rungs[2].increment_m2 == (0.0, 0.0, 0.0)
    assert budget.rungs[3].increment_m2 == (0.0, 0.0, 0.0)
    total = sum(rung.increment_m2.mean for rung in budget.rungs[1:])
    assert total == pytest.approx(budget.rungs[-1].mse_m2 - budget.rungs[0].mse_m2, rel=1e-12)
    scenario = load_scenario("q1-long-dense", SHORT)
    errors = []
    for run in range(4):
        truth, recording = simulate(scenario, run_seed(0, run))
        assert truth.poses is not None
        difference = load_estimators(["ekf"])["ekf"](recording).poses[:, :2] - truth.poses[:, :2]
        errors.append(np.square(difference).sum(axis=1).mean())
    assert budget.rungs[-1].mse_m2 == pytest.approx(np.mean(errors), rel=1e-12)


def test_wrong_noise_is_charged_to_the_noise() -> None:
    wrong = load_scenario("q1-long-dense", [*SHORT, "assumed.sensor_scale=0.01"])
    right = load_scenario("q1-long-dense", SHORT)
    for seed in range(2):
        errors, honest = rung_errors(wrong, seed, "riekf")[0], rung_errors(right, seed, "riekf")[0]
        np.testing.assert_array_equal(errors[:2], honest[:2])
        assert errors[2] != errors[1]
        assert errors[3] == errors[2]


def test_wrong_associations_are_charged_to_the_associations(monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter that takes two landmarks for one, and rejects a third, but solves that problem perfectly."""
    causal = load_estimators(["causal"])["causal"]

    def confused(recording: Recording, **_: object) -> Estimate:
        assert recording.landmark is not None
        given = np.where(recording.landmark == 1, 0, recording.landmark)
        kept = given != 2
        seen = replace(recording.only(kept), landmark=given[kept])
        return replace(causal(seen), association=np.where(kept, given, -1))

    monkeypatch.setattr("slamgauge.ekf.ekf_slam", confused)
    errors = rung_errors(load_scenario("q1-long-dense", SHORT), 0, "ekf")[0]
    assert errors[3] != errors[2]
    assert errors[2] == errors[1]
    assert errors[4] == errors[3]


def test_a_filter_without_ids_pays_for_its_associations_alone() -> None:
    """At gate 100 on measurements that the optimum sees with their true noise and associations."""
    errors = rung_errors(load_scenario("q2-gate-100", ["start=sampled", "trajectory.duration=12"]), 2, "ekf")[0]
    honest = rung_errors(load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=12"]), 2, "ekf")[0]
    np.testing.assert_array_equal(errors[:3], honest[:3])
    assert errors[2] == errors[1]
    assert errors[3] > errors[2]
    assert errors[4] != errors[3]


@pytest.mark.gtsam
def test_a_window_that_holds_everything_costs_nothing_and_a_short_one_does() -> None:
    """Of bearings alone, whose landmarks a short window never places."""
    scenario = load_scenario("q4-three-landmarks", ["start=sampled", "trajectory.duration=4"])
    steps = simulate(scenario, 0)[1].steps
    held, short = (rung_errors(scenario, 0, "riekf", lag)[0] for lag in (steps + 1, 2))
    assert len(held) == len(RUNGS)
    assert held[4] == pytest.approx(held[3], rel=1e-3)
    assert short[4] > 1.001 * short[3]
    np.testing.assert_array_equal(np.delete(held, 4), np.delete(short, 4))


@pytest.mark.gtsam
def test_the_rung_of_a_lag_stands_where_one_was_asked_for() -> None:
    with ThreadPoolExecutor(1) as executor:
        budget = error_budget(load_scenario("q1-short-dense", SHORT), "ekf", 2, 0, executor, lag=3)
    assert budget.to_json()["seed"] == 0
    assert [rung.name for rung in budget.rungs] == list(RUNGS)
    with pytest.raises(UserError, match="lag: 0 steps leave no window"):
        rungs_of("ekf", 0)


def test_the_costliest_rung_is_named_with_its_share() -> None:
    table = np.array([[1.0, 1.5, 1.5, 1.5, 4.0], [1.0, 2.0, 2.0, 2.0, 4.0]])
    unchecked = np.full_like(table, np.nan)
    budget = summarise_budget("somewhere", "ekf", table, unchecked, np.ones(2))
    assert budget.costliest == "linearisation"
    assert budget.rungs[1].increment_m2.mean == 0.75
    assert max(map(len, budget_table(budget).text(80).splitlines())) <= 80
    assert str(budget_table(budget)).splitlines()[-1] == (
        "ekf on somewhere, 2 runs: of 4.0000 m^2 (RMS 2.000 m) 1.0000 m^2 no estimator avoids; "
        "most of the rest goes to linearisation: 2.2500 m^2, 56% of the whole."
    )
    assert str(budget_table(summarise_budget("here", "riekf", np.ones((1, 5)), unchecked[:1], np.ones(1)))).endswith(
        "no rung above that costs anything."
    )


def test_what_the_runs_do_not_show_to_cost_anything_is_said_so() -> None:
    table = np.array([[1.0, 1.0, 1.0, 1.0, 4.0], [1.0, 1.0, 1.0, 1.0, 0.5], [1.0, 1.0, 1.0, 1.0, 0.9]])
    budget = summarise_budget("here", "ekf", table, np.full_like(table, np.nan), np.ones(3))
    assert str(budget_table(budget)).endswith("m^2, 44% of the whole, which 3 runs cannot tell from 0.")
    one = summarise_budget("here", "ekf", table[:1], np.full((1, 5), np.nan), np.ones(1))
    assert str(budget_table(one)).endswith("75% of the whole, which 1 run cannot tell from 0.")


def test_an_estimator_that_fails_is_named_with_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: Recording, **__: object) -> Estimate:
        raise UserError("no luck")

    monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(ValueError, match=rf"^run with seed {run_seed(0, 0)}: estimator ekf: no luck$"),
    ):
        error_budget(load_scenario("q1-long-dense", SHORT), "ekf", 2, 0, executor)


@pytest.mark.usefixtures("studies_in_a_thread")
def test_the_command_writes_table_json_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["budget", "q1-long-dense", "--set", "trajectory.duration=3", "--runs", "2", "--jobs", "1"]
    assert main([*words, "--out", str(tmp_path / "budget")]) == 0
    printed = capsys.readouterr().out
    content = held("budget", json.loads((tmp_path / "budget" / "budget.json").read_text()))
    origin = {"version", "command", "scenario_text"}
    assert set(content) == {
        *origin,
        "scenario",
        "filter",
        "runs",
        "seed",
        "digest",
        "rungs",
        "costliest",
        "verdict",
        "chi_square_per_dof",
        "notes",
    }
    assert content["verdict"] in printed.splitlines()
    assert "no estimator avoids" in content["verdict"]
    assert set(content["rungs"][0]) == {"name", "mse_m2", "increment_m2", "optimum_check_share", "in_doubt"}
    assert (tmp_path / "budget" / "budget.png").stat().st_size > 0


def test_rungs_that_are_optima_in_doubt_are_marked_and_named(tmp_path: Path, saved: dict[str, Figure]) -> None:
    table = np.array([[1.0, 1.5, 1.5, 2.0, 4.0], [1.0, 2.0, 2.0, 2.5, 4.0]])
    sure = np.array([[np.nan, 0.01, 0.01, 0.05, np.nan]] * 2)
    doubtful = sure.copy()
    doubtful[0, 3] = np.inf
    budget = summarise_budget("somewhere", "ekf", table, doubtful, np.ones(2))
    assert str(budget_table(summarise_budget("somewhere", "ekf", table, sure, np.ones(2)))).count("?") == 0
    lines = str(budget_table(budget)).splitlines()
    assert [line.count("?") for line in lines[:6]] == [0, 0, 0, 0, 1, 1]
    assert "linearisation: 1.7500? m^2, 44%? of the whole." in lines[-2]
    note = (
        "own associations: causal is more than 0.05 sigma from the optimum at a checked step in 50.0% of the runs: "
        "figures relative to it are marked ?"
    )
    assert lines[-1] == note
    shares = [rung["optimum_check_share"] for rung in budget.to_json()["rungs"]]
    assert shares == [None, 0.0, 0.0, 0.5, None]
    save_budget_figure(tmp_path, budget)
    (axes,) = saved["budget"].axes
    assert [text.get_text().count("?") for text in axes.texts] == [0, 0, 0, 1, 1, 0]
    assert note.replace(": ", ":\n", 1) in axes.get_title(loc="left")


def test_optima_that_are_none_of_what_has_happened_are_said_to_be_so(tmp_path: Path, saved: dict[str, Figure]) -> None:
    """The odometry errs in a way that nobody is told of: residuals are not those of the stated noise."""
    changes = ["start=sampled", "trajectory.duration=20", "motion.scale_error=0.5"]
    scenario = load_scenario("q1-long-dense", changes)
    with ThreadPoolExecutor(1) as executor:
        budget = error_budget(scenario, "ekf", 3, 0, executor)
    assert budget.fit is not None
    assert budget.fit.low is not None
    assert budget.fit.low > 1.05
    note = (
        "the residuals of batch and causal are not those of the stated noise: no optimum of what has happened; "
        "figures relative to them are marked ?"
    )
    lines = str(budget_table(budget)).splitlines()
    assert note in lines
    assert [line.count("?") for line in lines[:6]] == [0, 1, 1, 1, 1, 1]
    assert budget.to_json()["chi_square_per_dof"]["mean"] == budget.fit.mean
    save_budget_figure(tmp_path, budget)
    assert "no optimum of what has happened" in saved["budget"].axes[0].get_title(loc="left")


def test_a_run_tells_the_checks_of_its_optima(monkeypatch: pytest.MonkeyPatch) -> None:
    causal = load_estimators(["causal"])["causal"]

    def checked(recording: Recording) -> Estimate:
        return replace(causal(recording), optimum_check=0.3)

    monkeypatch.setattr("slamgauge.graph_baseline.causal", checked)
    checks = rung_errors(load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=1"]), 0, "ekf").checks
    np.testing.assert_array_equal(checks, [np.nan, 0.3, 0.3, 0.3, np.nan])


@pytest.mark.parametrize(
    "words", [["--filter", "batch"], ["--estimators", "batch"], ["--filter", "efk"], ["--seed", "-1"], ["--runs", "0"]]
)
def test_bad_input_is_one_line_and_exit_2(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["budget", "q1-long-dense", "--out", str(tmp_path / "budget"), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "budget").exists()
