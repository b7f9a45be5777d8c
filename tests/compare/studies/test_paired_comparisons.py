"""Paired comparisons of the estimators of a study, and the runs that they need."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scoring.intervals import Interval, compare_paired, needed_runs, ratio_interval
from slamgauge.compare.scoring.runs import FIRST_STEP, Runs
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.given import given

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]

NAMES = ("ekf", "riekf", "dead-reckoning")


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


def test_a_study_prints_how_many_runs_a_ratio_needs_that_is_not_significant(run: Run):
    """The ratios of `iekf` and of its copy are known to 5 % after 8 runs, the one of dead reckoning is not."""
    chosen = {name: name for name in ("ekf", "iekf", "dead-reckoning")} | {"mine": load_estimators(["iekf"])["iekf"]}
    summary = run(8, chosen, against=["ekf"])
    ratios = {label: found["ate_m"].ratio for label, found in summary.against["ekf"].items()}
    widths = {label: width(ratio) for label, ratio in ratios.items()}
    assert widths["mine"] == widths["iekf"] < 0.1 < widths["dead-reckoning"]
    below, mine, _ = str(summary_table(summary)).splitlines()[-3:]
    needed = needed_runs(given(ratios["dead-reckoning"]), 8)
    assert needed
    assert below == f"dead-reckoning against ekf: x ATE is not significant{needed}"
    assert mine.endswith("times that of ekf on the same 8 runs (95 % interval): the difference is not significant")
    ((_, few),) = run(3, {"ekf": "ekf", "mine": chosen["mine"]}).comparisons
    assert re.search(r": the difference is not significant: about \d+ runs are needed to know it to 5 %$", few)


def width(interval: Interval | None) -> float:
    assert interval is not None and interval.low is not None and interval.high is not None
    return interval.high - interval.low


def test_an_unknown_reference_is_refused_before_anything_is_written(run: Run, tmp_path: Path):
    with pytest.raises(UserError, match="'riekf': is not among --estimators; choose from ekf"):
        run(5, ["ekf"], "out", against=["riekf"])
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_the_command_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = str(tmp_path / "out")
    words = ["study", "q1-long-dense", "--set", "trajectory.duration=2", "--jobs", "1", "--out", out, "--runs", "3"]
    assert main([*words, "--estimators", "ekf,riekf", "--against", "ekf"]) == 0
    assert "\nagainst ekf  runs" in capsys.readouterr().out
    content = json.loads((tmp_path / "out/summary.json").read_text())
    assert content["against"]["ekf"]["riekf"]["ate_m"]["runs"] == content["runs"] == 3
    assert np.isfinite(content["against"]["ekf"]["riekf"]["ate_m"]["p_value"])
    assert main([*words, "--sweep", "association.gate=1,9", "--against", "ekf"]) == 2
    assert "sweep: takes no --against" in capsys.readouterr().err
