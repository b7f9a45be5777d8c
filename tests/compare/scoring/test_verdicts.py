"""Verdicts: sentences by figures, and the false-alarm rate for a right filter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from slamgauge.compare.scoring.comparison import SCATTER
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import WORTH, Interval, needed_runs
from slamgauge.compare.scoring.verdicts import BAND_LEVEL, Evidence

TEXTBOOK = Evidence(
    runs=100,
    nees_per_dof=4.84,
    coverage_95=0.61,
    nis_per_dof=1.002,
    nis_dof=2_900_000,
    ratio=Interval(1.42, 1.25, 1.59),
    ratio_runs=100,
    optimum="causal optimum",
    wrong_associations=0.0,
)
RIGHT = replace(TEXTBOOK, nees_per_dof=0.98, coverage_95=0.951, nis_per_dof=1.0, ratio=Interval(0.99, 0.97, 1.01))
EXPECTED = "as large as it expects: the stated noise is"
ERROR = "the causal optimum's error"


def test_the_textbook_filter_and_a_right_one():
    assert TEXTBOOK.verdict() == (
        "claims 2.2 times too small a sigma (95 % ellipses contain 61 %); "
        "1.42 ± 0.17 times the causal optimum's error; "
        "associations and noise are right, so the cause is its linearisation or a bug; NIS does not show this"
    )
    assert RIGHT.verdict() == (
        "its sigmas are right as far as 100 runs show (95 % ellipses contain 95 %); "
        "as accurate as the causal optimum (0.99 ± 0.02)"
    )


@pytest.mark.parametrize(
    ("changed", "said", "unsaid"),
    [
        ({"nees_per_dof": 0.25, "coverage_95": 0.999}, "2 times too large a sigma (95 % ellipses contain 100 %)", ""),
        ({"nees_per_dof": 0.0}, "has no error at all, whatever sigma it claims: check whether it receives the", "inf"),
        ({"nis_per_dof": 1.69}, f"innovations are 1.3 times {EXPECTED} too small", "show this"),
        ({"nis_per_dof": 0.25}, f"innovations are 0.5 times {EXPECTED} too large", "show this"),
        ({"nis_per_dof": 1.05}, "linearisation", "innovations"),  # small deviations are not stated
        ({"nis_per_dof": 1.11}, "innovations are 1.1 times", "linearisation"),
        ({"nis_per_dof": None, "nis_dof": 0}, "claims", "linearisation"),
        ({"wrong_associations": 12.3}, "; 12 wrong associations per run;", "linearisation"),
        ({"wrong_associations": 0.25}, "; 0.25 wrong associations per run;", "linearisation"),
        ({"wrong_associations": None}, "claims", "linearisation"),
        ({"nees_per_dof": 1.0}, "1.42 ± 0.17 times", "linearisation"),
        ({"ratio": None}, "claims", "times the"),
        ({"ratio": Interval(1.02, 1.01, 1.03)}, "as accurate as the causal optimum (1.02 ± 0.01)", "cause"),
        ({"ratio": Interval(0.8, 0.7, 0.9)}, f"0.80 ± 0.10 times {ERROR}, less than the optimum's", "cause"),
        ({"ratio": Interval(0.96, 0.93, 0.99)}, f"0.96 ± 0.03 times {ERROR}", "less than"),
        ({"ratio": Interval(1.02, 0.92, 1.12)}, "error, not significant: about 400 runs are needed", "cause"),
        ({"ratio": Interval(0.96, 0.91, 1.01)}, f"0.96 ± 0.05 times {ERROR}, not significant;", "runs"),
    ],
)
def test_sentences_by_figures(changed: dict[str, object], said: str, unsaid: str):
    sentence = str(replace(TEXTBOOK, **changed).verdict())  # pyrefly: ignore[bad-argument-type]
    assert said in sentence
    assert not unsaid or unsaid not in sentence


def test_faults_are_those_of_the_verdict_without_sizes():
    assert TEXTBOOK.faults() == ("claims too small a sigma", "worse than the causal optimum")
    other = replace(TEXTBOOK, nees_per_dof=0.0, ratio=None, nis_per_dof=0.25, wrong_associations=12.0)
    assert other.faults() == ("claims too large a sigma", "wrong associations", "innovations smaller than it expects")
    right = replace(RIGHT, ratio=Interval(1.02, 0.92, 1.12), wrong_associations=12.0)
    assert RIGHT.faults() == right.faults() == ()


def test_a_single_run_shows_only_gross_errors():
    single = replace(TEXTBOOK, runs=1, ratio=None, ratio_runs=0, nis_dof=29_000)
    assert single.verdict() is not None and replace(single, nees_per_dof=4.0).verdict() is None
    assert replace(single, nees_per_dof=None, nis_per_dof=None, nis_dof=0).verdict() is None


def test_small_deviations_are_not_stated():
    barely = chi2_band(BAND_LEVEL, 3 * 10_000)[1] / 30_000
    assert math.sqrt(barely) < 1 + WORTH  # significant, yet small
    assert "claims" not in str(replace(RIGHT, runs=10_000, nees_per_dof=barely + 0.001).verdict())
    assert "claims" in str(replace(RIGHT, runs=10_000, nees_per_dof=(1 + WORTH) ** 2 + 1e-6).verdict())


def test_the_number_of_runs_for_five_percent():
    """Rayleigh-distributed errors, which last a whole run; bounds of a variance of 420 draws, twice 0.1 %."""
    half = 1.959964 * SCATTER / math.sqrt(20)
    assert needed_runs(Interval(1.0, 1.0 - half, 1.0 + half), 20).startswith(": about 420 runs are needed")
    assert needed_runs(Interval(1.0, 0.95, 1.05), 20) == needed_runs(Interval(1.0, None, None), 1) == ""
    rng = np.random.default_rng(3)
    errors = np.hypot(*rng.standard_normal((2, 2000, 420)))
    half = 1.96 * errors.std(axis=1, ddof=1) / math.sqrt(420) / errors.mean(axis=1)
    assert np.mean(half) == pytest.approx(WORTH, rel=0.02)


@pytest.mark.parametrize("lasting", [0.0, 0.9, 0.99, 1.0])
@pytest.mark.parametrize("runs", [1, 20])
def test_a_right_filter_fails_with_at_most_the_stated_probability(lasting: float, runs: int):
    """Errors of any correlation over time fail with 1 - BAND_LEVEL at most, and equal if they last (0.999 bounds)."""
    rng = np.random.default_rng(11)
    trials, steps = 4000, 60
    errors, nees = rng.standard_normal((trials * runs, 3)), np.zeros(trials * runs)
    for _ in range(steps):
        errors = lasting * errors + math.sqrt(1 - lasting**2) * rng.standard_normal(errors.shape)
        nees += np.square(errors).sum(axis=1) / (3 * steps)
    means = nees.reshape(trials, runs).mean(axis=1)
    low, high = np.array(chi2_band(BAND_LEVEL, 3 * runs)) / (3 * runs)
    accused = int(np.sum((means < low) | (means > high)))
    fewest, most = stats.binom.interval(0.999, trials, 1 - BAND_LEVEL)
    assert fewest * (lasting == 1.0) <= accused <= most
