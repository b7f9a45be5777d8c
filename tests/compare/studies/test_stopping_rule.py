"""Paired comparisons, and studies that end when their ratios are precise enough."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scoring.aggregation import FIRST_STEP
from slamgauge.compare.scoring.intervals import Interval, compare_paired, ratio_interval
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.sequential import plan_looks
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.stopping_rule import Until, is_narrow
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.json_schemas import held

from .conftest import figures_of

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]

NAMES = ("ekf", "riekf", "dead-reckoning")
UNTIL = Until(precision=0.25, most=40)


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=3"])


def test_pairs_are_those_of_the_stored_runs(run: Run, load: Load):
    summary = run(6, NAMES, against=["ekf"])
    runs = load(6, NAMES)
    assert {name: [*others] for name, others in summary.against.items()} == {"ekf": ["riekf", "dead-reckoning"]}
    for label, found in summary.against["ekf"].items():
        ours, theirs = runs[label], runs["ekf"]
        assert found["ate_m"] == compare_paired(ours.figures["ate_m"], theirs.figures["ate_m"])
        nees = [each.series["nees_pose"][:, FIRST_STEP:].mean(axis=1) / 3 for each in (ours, theirs)]
        expected = compare_paired(*nees)
        assert expected is not None
        assert found["nees_pose_per_dof"].difference == pytest.approx(expected.difference)
        assert found["nees_pose_per_dof"].p_value == pytest.approx(expected.p_value)
    entry = summary.to_json()["against"]["ekf"]["riekf"]["ate_m"]
    assert {*entry} == {"runs", "difference", "ratio", "p_value"}
    assert "\nagainst ekf" in str(summary_table(summary))


def test_a_study_ends_with_a_comparison_of_user_code_with_built_in_filters(run: Run, load: Load):
    """User code is not compared with optima, dead reckoning or estimates of another kind."""
    ekf = load_estimators(["ekf"])["ekf"]

    def worse(recording: Recording) -> Estimate:
        estimate = ekf(recording)
        return replace(estimate, poses=estimate.poses + np.array([1.0, 0.0, 0.0]))

    chosen = {name: name for name in ("ekf", "dead-reckoning", "causal", "batch")} | {"same": ekf, "worse": worse}
    summary, runs = run(8, chosen), load(8, chosen)
    ratio = ratio_interval(runs["worse"].figures["ate_m"], runs["ekf"].figures["ate_m"])
    assert ratio is not None
    assert ratio.low is not None
    assert ratio.low > 1
    assert str(summary_table(summary)).splitlines()[-2:] == [
        "the ATE of same is 1.000 ± 0.000 times that of ekf on the same 8 runs (95 % interval): "
        "the difference is not significant",
        f"the ATE of worse is {ratio.mean:.3f} ± {ratio.mean - ratio.low:.3f} times that of ekf on the same 8 runs "
        "(95 % interval): the difference is significant",
    ]
    assert run(1, {"ekf": "ekf", "same": ekf}).comparisons == (
        ("same", "the ATE of same is 1.000 times that of ekf on the same 1 run; an interval needs 2 runs"),
    )


def test_a_study_ends_at_the_first_look_with_the_precision(run: Run, load: Load):
    summary = run(5, NAMES, against=["ekf"], until=UNTIL)
    looks = plan_looks(5, UNTIL.most)
    assert summary.precision is not None
    assert summary.precision.look in looks[1:-1]
    assert summary.runs == summary.precision.look.runs
    runs = load(UNTIL.most, NAMES)
    assert {len(each.run) for each in runs.values()} == {summary.runs}  # no run was useless
    for look in looks[: summary.precision.look.number]:
        ates = {name: each.figures["ate_m"][: look.runs] for name, each in runs.items()}
        ratios = [ratio_interval(ates[name], ates["ekf"], look.level) for name in ("riekf", "dead-reckoning")]
        known = [each is not None and is_narrow(each, UNTIL.precision) for each in ratios]
        assert all(known) == (look == summary.precision.look)
        if look == summary.precision.look:
            assert [*summary.precision.ratios.values()] == ratios
            assert summary.against["ekf"]["riekf"]["ate_m"].ratio == ratios[0]
    entry = summary.to_json()["precision"]
    assert (entry["target"], entry["reached"], entry["most_runs"]) == (0.25, True, 40)
    assert f"with {summary.runs} runs (look" in str(summary_table(summary))


def test_p_values_hold_at_all_looks(run: Run):
    once = run(5, ("ekf", "riekf"), against=["ekf"])
    again = run(5, ("ekf", "riekf"), against=["ekf"], until=Until(precision=0.99, most=40))
    assert again.runs == 5
    first, held = (each.against["ekf"]["riekf"]["ate_m"] for each in (once, again))
    assert first.p_value is not None
    assert held.p_value is not None
    assert first.p_value < held.p_value <= 1
    assert width(first.difference) < width(held.difference)


def width(interval: Interval) -> float:
    assert interval.low is not None
    assert interval.high is not None
    return interval.high - interval.low


def test_a_study_that_does_not_reach_the_precision_ends_at_the_most_runs(run: Run):
    summary = run(3, ("ekf", "causal"), until=Until(precision=1e-6, most=7))
    assert summary.runs == 7
    assert summary.precision is not None
    assert not summary.precision.reached
    assert [*summary.precision.ratios] == [("ekf", "causal")]  # default: ratios to the optimum
    assert "not reached with 7 runs" in str(summary_table(summary))


def test_a_ratio_without_runs_is_not_precise(run: Run):
    def broken(_: Recording) -> Estimate:
        raise ArithmeticError

    summary = run(3, {"ekf": "ekf", "broken": broken}, against=["ekf"], until=UNTIL)
    assert summary.precision is not None
    assert (summary.runs, summary.precision.reached) == (3, False)  # more runs would be useless
    line = next(line for line in str(summary_table(summary)).splitlines() if line.startswith("precision"))
    assert ": not reached with 3 runs " in line
    assert line.endswith("broken / ekf unknown, no run has both")


def test_an_interrupted_study_ends_where_it_would_have_ended(run: Run, monkeypatch: pytest.MonkeyPatch):
    options = {"against": ["ekf"], "until": UNTIL}
    whole = run(5, NAMES, "whole", **options)
    assert whole.runs > 8  # beyond the look at which it is interrupted below
    original, left = study_run.run_once, [6]

    def killed(*arguments: Any) -> list[Outcome]:
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        return original(*arguments)

    monkeypatch.setattr("slamgauge.compare.studies.study.run_once", killed)
    for runs in (6, 1):  # the second time after a single run more
        left[0] = runs
        with pytest.raises(KeyboardInterrupt):
            run(5, NAMES, "parts", **options)
    monkeypatch.undo()
    with local_processes(2) as executor:
        parts = run(5, NAMES, "parts", executor=executor, **options)
    assert figures_of(parts) == figures_of(whole)
    run(whole.runs + 2, NAMES, "parts")  # additional runs in the store change nothing
    assert figures_of(run(5, NAMES, "parts", **options)) == figures_of(whole)


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        (["ekf"], {"against": ["riekf"]}, "'riekf': is not among --estimators; choose from ekf"),
        (["ekf"], {"until": Until(0.1, 10)}, "no ratio exists; add causal"),
        (["ekf", "causal"], {"until": Until(1.5, 10)}, "precision: 1.5 is not a share"),
        (["ekf", "causal"], {"until": Until(0.1, 3)}, "max-runs: 3 are fewer than the 5"),
    ],
)
def test_bad_options_are_refused_before_anything_is_written(
    run: Run, tmp_path: Path, names: list[str], options: dict[str, Any], message: str
):
    with pytest.raises(UserError, match=message):
        run(5, names, "out", **options)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_the_command_compares_and_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = str(tmp_path / "out")
    words = ["study", "q1-long-dense", "--set", "trajectory.duration=2", "--jobs", "1", "--out", out, "--runs", "3"]
    options = ["--estimators", "ekf,riekf", "--against", "ekf", "--precision", "0.9", "--max-runs", "4"]
    assert main([*words, *options]) == 0
    printed = capsys.readouterr().out
    assert "precision 90 %: reached with 3 runs" in printed
    assert "\nagainst ekf  runs" in printed
    content = held("summary", json.loads((tmp_path / "out/summary.json").read_text()))
    assert content["against"]["ekf"]["riekf"]["ate_m"]["runs"] == content["runs"] == 3
    assert np.isfinite(content["against"]["ekf"]["riekf"]["ate_m"]["p_value"])
    assert main([*words, "--sweep", "association.gate=1,9", "--against", "ekf"]) == 2
    assert "sweep: takes no --against" in capsys.readouterr().err
