"""Bounds on errors: which figures and which differences from a reference fail, and which pass."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.error_bounds import NO_COVS, against_reference, assert_error_bounds
from slamgauge.compare.scoring.runs import FIRST_STEP
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth
from tests.reference.given import given

from .builders import straight

STEPS = 30


def resting_run(seed: int) -> Score:
    """Return the score of one step with random pose errors and white innovations, 2 degrees of freedom a step."""
    rng = np.random.default_rng(seed)
    sigmas = np.array([1.0, 2.0, 0.1])  # heading errors far from pi
    errors, covs = sigmas * rng.normal(size=(2, 3)), np.tile(np.diag(sigmas) ** 2, (2, 1, 1))
    estimate = Estimate("filtered", errors, covs, nis=rng.chisquare(2, size=2), nis_dof=np.array([2, 2]))
    return evaluate(Truth(np.zeros((2, 3))), straight(1), estimate)


SCORE = resting_run(0)


def failure(score: Score | list[Score], **bounds: Any) -> str:
    with pytest.raises(AssertionError) as caught:
        assert_error_bounds(score, **bounds)
    return str(caught.value)


def with_figures(score: Score = SCORE, **changes: Any) -> Score:
    """Return a score with other figures, or other arrays `nees` and `sigmas`."""
    arrays = {name: changes.pop(name) for name in ("nees", "sigmas") if name in changes}
    return replace(score, figures={**score.figures, **changes}, **arrays)


def test_bounds_that_hold_raise_nothing_and_every_other_one_is_shown_with_its_figure() -> None:
    score = with_figures(ate_m=0.5, nees=np.array([9.0, 3.0]), nis_total=4.0)
    assert_error_bounds(score, max_ate_m=0.5, nees_level=0.95, nis_level=0.95)
    score = with_figures(ate_m=0.75, nees=np.array([3.0, 30.0]), nis_total=0.01)
    lines = failure(score, max_ate_m=0.5, nees_level=0.95, nis_level=0.99).splitlines()
    assert lines == [
        "3 error bound(s) failed:",
        "  ate_m = 0.75 exceeds max_ate_m = 0.5",
        "  pose NEES at the last step = 30 is outside [0.2158, 9.348], the 95 % chi-square band: "
        "the estimator is too sure",
        "  NIS = 0.0025 is outside [0.05175, 3.715], the 99 % chi-square band: the estimator is too cautious",
    ]
    runs = [with_figures(ate_m=1.0), with_figures(ate_m=2.0)]
    assert_error_bounds(runs, max_ate_m=1.5)
    assert "ate_m = 1.5 (mean of 2 runs) exceeds max_ate_m = 1.4" in failure(runs, max_ate_m=1.4)


def test_the_edges_of_the_nees_band_are_those_of_its_sum() -> None:
    low, high = chi2_band(0.9, 9)
    for edge, inside, side in ((low, 1.001, "cautious"), (high, 0.999, "sure")):
        right, wrong = (
            [with_figures(nees=np.array([np.nan, share * total])) for share in (0.2, 0.3, 0.5)]
            for total in (edge * inside, edge / inside)
        )
        assert_error_bounds(right, nees_level=0.9)
        assert f"the estimator is too {side}" in failure(wrong, nees_level=0.9)


def test_a_missing_figure_fails_with_its_remedy() -> None:
    nothing = {"ate_m": None, "nis_total": 0.0, "nis_dof_total": 0}
    scores = [with_figures(nees=np.array([3.0, np.nan]), **nothing), resting_run(1)]
    message = failure(scores, max_ate_m=9, nees_level=0.95, nis_level=0.95)
    for line in (
        "ate_m is missing in 1 of 2 run(s): evaluate with a Truth that has poses",
        "pose NEES at the last step is missing in 1 of 2 run(s): it needs the true last pose and",
        "NIS is missing in 1 of 2 run(s): return an Estimate with nis and nis_dof",
    ):
        assert line in message


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({}, "no bound given; pass max_ate_m, "),
        ({"max_ate_m": 0.0}, "max_ate_m = 0.0: no error can keep it; "),
        ({"max_ate_m": math.nan}, "max_ate_m = nan: "),
        ({"nees_level": 95.0}, "level = 95.0: not a probability"),
        ({"score": [], "max_ate_m": 1}, "score: no score given"),
        ({"score": [SCORE] * 3, "reference": [SCORE] * 2}, "reference: 2 scores for 3 of other runs"),
        ({"reference": [SCORE]}, "reference: a single run has no interval"),
    ],
)
def test_impossible_bounds_are_refused(bounds: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        assert_error_bounds(bounds.pop("score", SCORE), **bounds)


@pytest.mark.full  # a statistic of 300 groups of runs
@pytest.mark.parametrize("bound", ["nees_level", "nis_level"])
def test_right_runs_fail_as_often_as_the_levels_say(bound: str) -> None:
    """Failures of 300 groups of 5 runs at 90 %: binomial, two-sided false-alarm rate 0.1 % each (3.29 sigma)."""
    failures = 0
    for group in range(300):
        try:
            assert_error_bounds([resting_run(5 * group + run) for run in range(5)], **{bound: 0.9})  # pyrefly: ignore[bad-argument-type]
        except AssertionError:
            failures += 1
    assert abs(failures - 30) <= 3.29 * math.sqrt(300 * 0.1 * 0.9)


# --- relative to a reference ---------------------------------------------------------------------


def scores(ate: float = 1, nees: float = 3, sigma: float = 1, heading: float = 1, spread: float = 0) -> list[Score]:
    """Return 20 scores with these figures, times a factor that estimators share and an own factor of `spread`.

    The first steps, which do not count, have other figures.
    """
    shared, own = np.random.default_rng(0), np.random.default_rng(1)
    factors = [shared.lognormal(0.0, 0.3) * own.lognormal(0.0, spread) for _ in range(20)]
    sigmas = np.tile([sigma, sigma, heading], (STEPS + 1, 1))
    sigmas[:FIRST_STEP] = spread
    series = np.where(np.arange(STEPS + 1) < FIRST_STEP, 1e6 * (1 + spread), nees)
    return [with_figures(ate_m=ate * factor, nees=series * factor, sigmas=sigmas) for factor in factors]


def test_the_reference_keeps_its_own_bounds_and_its_ratios_are_one():
    ratios, broken = against_reference(scores(nees=9.0), scores(nees=9.0))
    assert broken == ()
    assert [astuple(given(ratio)) for ratio in ratios.values()] == [pytest.approx((1.0, 1.0, 1.0))] * 4


@pytest.mark.parametrize(
    ("ours", "reference", "said"),
    [
        ({"ate": 1.1}, {}, "ATE is 1.1 ± 0 times the reference's, more than 1.05"),
        ({"ate": 1.1, "spread": 0.5}, {}, ""),  # not significant
        ({"nees": 9.0}, {"nees": 6.0}, "NEES is 1.5 ± "),
        ({"nees": 2.0}, {"nees": 1.0}, ""),  # at most a consistent estimate's
        ({"sigma": 0.8, "nees": 4.0}, {"nees": 4.0}, "sigma of the position is 0.8 ± 0 times the reference's, less"),
        ({"heading": 1.3, "nees": 1.0}, {}, "sigma of the heading is 1.3 ± 0 times the reference's, more than"),
        ({"sigma": 1.5, "heading": 1.5, "nees": 3.0}, {"nees": 9.0}, ""),  # the reference is too sure
        ({"sigma": 0.5, "nees": 3.0}, {"nees": 1.0}, ""),  # the reference is too cautious
        ({"sigma": 0.5, "nees": 9.0}, {"nees": 1.0}, "NEES is 9 ± "),
    ],
)
def test_rules(ours: dict[str, Any], reference: dict[str, Any], said: str):
    found = against_reference(scores(**ours), scores(**reference))[1]
    assert found[0].startswith(said) if said else not found


def test_without_covariances_an_estimator_fails():
    bare = [replace(each, nees=np.full(STEPS + 1, np.nan), sigmas=np.full((STEPS + 1, 3), np.nan)) for each in scores()]
    assert against_reference(bare, scores())[1] == (NO_COVS,)
    assert NO_COVS in failure(bare, reference=scores(), max_ate_m=100.0)
    assert_error_bounds(bare, reference=bare)
    assert against_reference(bare, bare)[1] == ()
