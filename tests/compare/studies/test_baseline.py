"""Gate of a study against an earlier one: rates on synthetic pairs, and the command."""

from __future__ import annotations

import json
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


def test_false_alarms_at_the_tolerance():
    """5 % of 1000 gates whose true ratio is the tolerance; the bounds are 3.5 standard deviations (0.7 %) away."""
    assert 0.025 <= share_of_failures(1.05, 30) <= 0.075


def test_no_change_hardly_ever_fails_and_a_large_one_is_found():
    assert share_of_failures(1.0, 30) <= 0.02
    assert share_of_failures(1.3, 30) >= 0.9


def test_studies_with_different_numbers_of_runs_are_compared_on_the_common_ones():
    """Runs that only one of the two studies has are neither compared nor lost."""
    ate = np.random.default_rng(0).uniform(0.9, 1.1, 20)
    few, many = study(ate[:8].tolist()), study((ate * np.repeat([1.0, 3.0], [8, 12])).tolist())
    for current, baseline in ((few, many), (many, few)):
        lines, worse = gate_of(baseline).judge(current)
        assert "ATE is 1.000 (1.000 to 1.000) times the baseline's on 8 runs: not worse" in lines[0]
        assert not worse
    assert_not_worse(few, many)


def test_a_figure_that_only_runs_beyond_the_baseline_have_is_missing():
    ate = np.random.default_rng(0).uniform(0.9, 1.1, 8)
    baseline = study(ate[:4].tolist(), [1.0] * 4)
    late = RunFigures([*range(8)], ate.tolist(), [None] * 4 + [1.0] * 4)
    _, worse = gate_of(baseline).judge(replace(baseline, runs=8, per_run={"mine": late}))
    assert worse == ["mine: has no NEES, as the baseline has"]


def test_assert_not_worse():
    rng = np.random.default_rng(0)
    ate, nees = rng.uniform(0.9, 1.1, 20), rng.uniform(0.9, 1.1, 20)
    baseline = study(ate.tolist(), nees.tolist())
    assert_not_worse(baseline, baseline)
    assert_not_worse(study((1.04 * ate).tolist(), nees.tolist()), baseline)
    with pytest.raises(
        AssertionError, match=r"mine: ATE is 1\.100 \(1\.100 to 1\.100\) times the baseline's on 20 runs"
    ):
        assert_not_worse(study((1.1 * ate).tolist(), nees.tolist()), baseline)
    assert_not_worse(study((1.1 * ate).tolist(), nees.tolist()), baseline, tolerance=0.2)
    with pytest.raises(AssertionError, match=r"mine: NEES is 2\.000"):
        assert_not_worse(study(ate.tolist(), (2 * nees).tolist()), baseline)
    with pytest.raises(AssertionError, match="mine: has no NEES, as the baseline has"):
        assert_not_worse(study(ate.tolist()), baseline)
    with pytest.raises(AssertionError, match="mine: fails in 1 run of the baseline, first in run 3"):
        assert_not_worse(study(np.delete(ate, 3).tolist(), None, [*range(3), *range(4, 20)]), baseline)
    with pytest.raises(UserError, match="tolerance = 50: not a share"):
        assert_not_worse(baseline, baseline, tolerance=50)


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
