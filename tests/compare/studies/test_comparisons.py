"""Paired comparisons of the estimators of a study and the runs that they need; the gate against an earlier study."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import assert_not_worse
from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scoring.intervals import compare_paired, needed_runs, ratio_interval
from slamgauge.compare.scoring.runs import FIRST_STEP, Runs
from slamgauge.compare.studies.baseline import Gate, open_gate
from slamgauge.compare.studies.summary import RunFigures, Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.command_line import run
from tests.reference.given import given

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]

NAMES = ("ekf", "riekf", "dead-reckoning")


def test_pairs_are_those_of_the_stored_runs(run: Run):
    summary = run(6, NAMES, against=["ekf"])
    assert "\nagainst ekf " in str(summary_table(summary))
    assert {name: [*others] for name, others in summary.against.items()} == {"ekf": ["riekf", "dead-reckoning"]}
    runs, written = summary.loaded, summary.to_json()["against"]["ekf"]
    for label, found in summary.against["ekf"].items():
        for key, figures in (("ate_m", ates), ("nees_pose_per_dof", late_nees)):
            assert found[key] == compare_paired(figures(runs[label]), figures(runs["ekf"]))
            assert (written[label][key]["runs"], written[label][key]["p_value"]) == (6, found[key].p_value)


def ates(runs: Runs) -> Float:
    return runs.figures["ate_m"]


def late_nees(runs: Runs) -> Float:
    return runs.series["nees_pose"][:, FIRST_STEP:].mean(axis=1) / 3


def test_a_study_ends_with_a_comparison_of_user_code_with_built_in_filters(run: Run):
    """User code is not compared with optima, dead reckoning or estimates of another kind."""
    ekf = load_estimators(["ekf"])["ekf"]

    def worse(recording: Recording) -> Estimate:
        estimate = ekf(recording)
        return replace(estimate, poses=estimate.poses + np.array([1.0, 0.0, 0.0]))

    chosen = {name: name for name in ("ekf", "dead-reckoning", "causal", "batch")} | {"same": ekf, "worse": worse}
    summary = run(8, chosen)
    ratio = ratio_interval(ates(summary.loaded["worse"]), ates(summary.loaded["ekf"]))
    assert ratio is not None and ratio.low is not None and ratio.low > 1
    assert str(summary_table(summary)).splitlines()[-2:] == [
        "the ATE of same is 1.000 ± 0.000 times that of ekf on the same 8 runs (95 % interval): "
        "the difference is not significant",
        f"the ATE of worse is {ratio.mean:.3f} ± {ratio.mean - ratio.low:.3f} times that of ekf on the same 8 runs "
        "(95 % interval): the difference is significant",
    ]
    assert run(1, {"ekf": "ekf", "same": ekf}).comparisons == (
        "the ATE of same is 1.000 times that of ekf on the same 1 run; an interval needs 2 runs",
    )


def test_a_study_prints_how_many_runs_a_ratio_needs_that_is_not_significant(run: Run):
    chosen = {name: name for name in ("ekf", "dead-reckoning")} | {"mine": load_estimators(["iekf"])["iekf"]}
    summary = run(3, chosen, against=["ekf"])
    needed = needed_runs(given(summary.against["ekf"]["dead-reckoning"]["ate_m"].ratio), 3)
    assert needed
    assert f"dead-reckoning against ekf: x ATE is not significant{needed}" in str(summary_table(summary)).splitlines()
    (line,) = summary.comparisons
    assert re.search(r": the difference is not significant: about \d+ runs are needed to know it to 5 %$", line)


def study(ate: Float, nees: Float | None = None, runs: list[int] | None = None) -> Summary:
    """Return a study of the estimator `mine` with these figures in runs 0, 1, ..."""
    numbers = [*range(len(ate))] if runs is None else runs
    figures = RunFigures(numbers, ate.tolist(), [None] * len(ate) if nees is None else nees.tolist())
    return Summary("any", len(ate), 0, "digest", (), {}, per_run={"mine": figures})


def gate_of(baseline: Summary) -> Gate:
    return open_gate((baseline), ["mine"], "digest", 0.05, "")


def pair(rng: np.random.Generator, runs: int) -> tuple[Float, Float]:
    """Return ATEs (runs,) of two studies with the same mean, a correlation of 0.8 and a spread of 30 %."""
    shared = rng.normal(size=runs)
    base, now = (np.exp(0.3 * (0.9 * shared + 0.44 * rng.normal(size=runs))) for _ in range(2))
    return base, now


@pytest.mark.parametrize(("true_ratio", "least", "most"), [(1.05, 0.025, 0.075), (1.0, 0.0, 0.02), (1.3, 0.9, 1.0)])
def test_rates_of_failing_gates(true_ratio: float, least: float, most: float):
    """At the tolerance 5 % of 1000 gates fail; those bounds are 3.5 standard deviations (0.7 %) away."""
    rng, failed = np.random.default_rng(0), 0
    for _ in range(1000):
        base, now = pair(rng, 30)
        _, worse = gate_of(study(base)).judge(study(true_ratio * now))
        failed += bool(worse)
    assert least <= failed / 1000 <= most


def test_studies_with_different_numbers_of_runs_are_compared_on_the_common_ones():
    """Runs that only one of two studies has are neither compared nor lost; a figure that only they have is missing."""
    ate = np.random.default_rng(0).uniform(0.9, 1.1, 20)
    few, many = study(ate[:8]), study(ate * np.repeat([1.0, 3.0], [8, 12]))
    for current, baseline in ((few, many), (many, few)):
        lines, worse = gate_of(baseline).judge(current)
        assert "ATE is 1.000 (1.000 to 1.000) times the baseline's on 8 runs: not worse" in lines[0]
        assert not worse
    baseline = study(ate[:4], np.ones(4))
    late = RunFigures([*range(8)], ate[:8].tolist(), [None] * 4 + [1.0] * 4)
    _, worse = gate_of(baseline).judge(replace(baseline, runs=8, per_run={"mine": late}))
    assert worse == ["mine: has no NEES, as the baseline has"]


def test_assert_not_worse():
    rng = np.random.default_rng(0)
    ate, nees = rng.uniform(0.9, 1.1, 20), rng.uniform(0.9, 1.1, 20)
    baseline = study(ate, nees)
    assert_not_worse(baseline, baseline)
    assert_not_worse(study(1.04 * ate, nees), baseline)
    assert_not_worse(study(1.1 * ate, nees), baseline, tolerance=0.2)
    lost = study(np.delete(ate, 3), None, [*range(3), *range(4, 20)])
    for worse, line in (
        (study(1.1 * ate, nees), r"ATE is 1\.100 \(1\.100 to 1\.100\) times the baseline's on 20 runs"),
        (study(ate, 2 * nees), r"NEES is 2\.000"),
        (study(ate), "has no NEES, as the baseline has"),
        (lost, "fails in 1 run of the baseline, first in run 3"),
    ):
        with pytest.raises(AssertionError, match=f"mine: {line}"):
            assert_not_worse(worse, baseline)
    with pytest.raises(UserError, match="tolerance = 50: not a share"):
        assert_not_worse(baseline, baseline, tolerance=50)


def test_a_ratio_that_is_not_significant_needs_more_runs():
    base, now = pair(np.random.default_rng(1), 30)
    (line,), _ = gate_of(study(base)).judge(study(1.03 * now))
    assert re.search(r": not significantly worse by more than 5 %: about \d+ runs are needed to know it to 5 %$", line)


FILTER = """
from dataclasses import replace
from slamgauge import ekf_slam

def estimate(recording):
    found = ekf_slam(recording)
    return replace(found, poses=found.poses + {shift})
"""


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    mine = tmp_path / "mine.py"
    mine.write_text(FILTER.format(shift=0.0))
    command = ("study", "q1-short-dense", "--set", "trajectory.duration=2", "--jobs", 1, "--no-report")
    command += ("--estimators", f"mine={mine}:estimate,causal")
    assert run(*command, "--runs", 6, "--out", tmp_path / "before") == 0
    baseline = tmp_path / "before" / "summary.json"
    gate = ("--runs", 4, "--baseline", baseline)
    assert run(*command, *gate, "--out", tmp_path / "same") == 0
    assert "mine: ATE is 1.000 (1.000 to 1.000) times the baseline's on 4 runs: not worse" in capsys.readouterr().err
    mine.write_text(FILTER.format(shift=1.0))
    assert run(*command, *gate, "--fail-if-worse", "10%", "--out", tmp_path / "worse") == 1
    printed = capsys.readouterr().err
    assert "on 4 runs: worse by more than 10 %" in printed
    assert "false alarms: if no true ratio exceeds 1.1, at most 5% of the gates fail\n" in printed
    for extra, message in (
        (("--seed", 1), "summary.json: has other measurements (another scenario, seed or --set)"),
        (("--fail-if-worse", "much"), "much is not a share; give for example 5% or 0.05"),
        (("--estimators", "ekf"), "has figures of none of these estimators; it has mine, causal"),
        (("--out", tmp_path / "before"), "this study would replace its baseline"),
    ):
        assert run(*command, *gate, "--out", tmp_path / "other", *extra) == 2
        assert message in capsys.readouterr().err
    content = json.loads(baseline.read_text())
    without_runs = {key: each for key, each in content.items() if key != "per_run"}
    for changed, message in (
        (content | {"version": "0.1.0"}, "summary.json: of slamgauge 0.1.0, this is"),
        (without_runs, "written by another version, or changed by hand"),
    ):
        baseline.write_text(json.dumps(changed))
        assert run(*command, *gate, "--out", tmp_path / "other") == 2
        assert message in capsys.readouterr().err
