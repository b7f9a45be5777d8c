"""Gate of a study against an earlier one: rates on synthetic pairs, and the command."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import Summary, UserError, assert_not_worse
from slamgauge.arrays import Float
from slamgauge.compare.studies.baseline import Gate, open_gate
from slamgauge.compare.studies.summary import RunFigures
from tests.reference.command_line import run

pytestmark = pytest.mark.slow

TRIALS = 1000


def study(ate: list[float], nees: list[float] | None = None, runs: list[int] | None = None) -> Summary:
    """Return a study of the estimator `mine` with these figures in runs 0, 1, ..."""
    numbers = [*range(len(ate))] if runs is None else runs
    figures = RunFigures(numbers, [*ate], [None] * len(ate) if nees is None else [*nees])
    return Summary("any", len(ate), 0, "digest", (), {}, per_run={"mine": figures})


def gate_of(baseline: Summary) -> Gate:
    return open_gate((baseline), ["mine"], "digest", 0.05, "")


def pair(rng: np.random.Generator, runs: int) -> tuple[Float, Float]:
    """Return ATEs (runs,) of two studies with the same mean, a correlation of 0.8 and a spread of 30 %."""
    shared = rng.normal(size=runs)
    base, now = (np.exp(0.3 * (0.9 * shared + 0.44 * rng.normal(size=runs))) for _ in range(2))
    return base, now


def share_of_failures(true_ratio: float, runs: int, trials: int = TRIALS) -> float:
    """Return the share of gates that fail."""
    rng = np.random.default_rng(0)
    failed = 0
    for _ in range(trials):
        base, now = pair(rng, runs)
        _, worse = gate_of(study(base.tolist())).judge(study((true_ratio * now).tolist()))
        failed += bool(worse)
    return failed / trials


@pytest.mark.parametrize(("true_ratio", "least", "most"), [(1.05, 0.025, 0.075), (1.0, 0.0, 0.02), (1.3, 0.9, 1.0)])
def test_rates_of_failing_gates(true_ratio: float, least: float, most: float):
    """At the tolerance 5 % of 1000 gates fail; those bounds are 3.5 standard deviations (0.7 %) away."""
    assert least <= share_of_failures(true_ratio, 30) <= most


def test_studies_with_different_numbers_of_runs_are_compared_on_the_common_ones():
    """Runs that only one of two studies has are neither compared nor lost; a figure that only they have is missing."""
    ate = np.random.default_rng(0).uniform(0.9, 1.1, 20)
    few, many = study(ate[:8].tolist()), study((ate * np.repeat([1.0, 3.0], [8, 12])).tolist())
    for current, baseline in ((few, many), (many, few)):
        lines, worse = gate_of(baseline).judge(current)
        assert "ATE is 1.000 (1.000 to 1.000) times the baseline's on 8 runs: not worse" in lines[0]
        assert not worse
    baseline = study(ate[:4].tolist(), [1.0] * 4)
    late = RunFigures([*range(8)], ate[:8].tolist(), [None] * 4 + [1.0] * 4)
    _, worse = gate_of(baseline).judge(replace(baseline, runs=8, per_run={"mine": late}))
    assert worse == ["mine: has no NEES, as the baseline has"]


def test_assert_not_worse():
    rng = np.random.default_rng(0)
    ate, nees = rng.uniform(0.9, 1.1, 20), rng.uniform(0.9, 1.1, 20)
    baseline = study(ate.tolist(), nees.tolist())
    assert_not_worse(baseline, baseline)
    assert_not_worse(study((1.04 * ate).tolist(), nees.tolist()), baseline)
    assert_not_worse(study((1.1 * ate).tolist(), nees.tolist()), baseline, tolerance=0.2)
    for worse, line in (
        (
            study((1.1 * ate).tolist(), nees.tolist()),
            r"ATE is 1\.100 \(1\.100 to 1\.100\) times the baseline's on 20 runs",
        ),
        (study(ate.tolist(), (2 * nees).tolist()), r"NEES is 2\.000"),
        (study(ate.tolist()), "has no NEES, as the baseline has"),
        (
            study(np.delete(ate, 3).tolist(), None, [*range(3), *range(4, 20)]),
            "fails in 1 run of the baseline, first in run 3",
        ),
    ):
        with pytest.raises(AssertionError, match=f"mine: {line}"):
            assert_not_worse(worse, baseline)
    with pytest.raises(UserError, match="tolerance = 50: not a share"):
        assert_not_worse(baseline, baseline, tolerance=50)


def test_a_ratio_that_is_not_significant_needs_more_runs():
    base, now = pair(np.random.default_rng(1), 30)
    (line,), _ = gate_of(study(base.tolist())).judge(study((1.03 * now).tolist()))
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
    baseline.write_text(json.dumps(content | {"version": "0.1.0"}))
    assert run(*command, *gate, "--out", tmp_path / "other") == 2
    assert "summary.json: of slamgauge 0.1.0, this is" in capsys.readouterr().err
    baseline.write_text(json.dumps({key: each for key, each in content.items() if key != "per_run"}))
    assert run(*command, *gate, "--out", tmp_path / "other") == 2
    assert "not what `slamgauge study` writes" in capsys.readouterr().err
