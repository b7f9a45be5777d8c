"""Paired comparisons against scipy, and their coverage where runs have luck in common."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from slamgauge.compare.scoring.intervals import Interval, ratio_interval
from slamgauge.compare.scoring.paired_comparison import Paired, compare_paired


def test_difference_and_p_value_are_students_of_the_pairs_that_are_whole():
    ours = np.array([1.0, 2.5, np.nan, 4.0, 7.0, 3.0])
    theirs = np.array([0.5, 2.0, 1.0, 3.0, 7.5, np.nan])
    found = compare_paired(ours, theirs, level=0.9)
    assert found is not None
    whole = [0, 1, 3, 4]
    differences = ours[whole] - theirs[whole]
    low, high = stats.t.interval(0.9, 3, loc=differences.mean(), scale=stats.sem(differences))
    assert found.runs == 4
    assert found.difference == pytest.approx((differences.mean(), low, high))
    assert found.p_value == pytest.approx(stats.ttest_rel(ours[whole], theirs[whole])[1])
    assert found.ratio == ratio_interval(ours, theirs, 0.9)


def test_what_cannot_be_said_is_not():
    assert compare_paired(np.array([np.nan, 1.0]), np.array([1.0, np.nan])) is None
    single = compare_paired(np.array([2.0]), np.array([1.0]))
    assert single == Paired(1, Interval(1.0, None, None), Interval(2.0, None, None), None)
    assert single is not None
    assert single.to_json()["difference"] == {"mean": 1.0, "low": None, "high": None}
    same = compare_paired(np.array([2.0, 3.0]), np.array([2.0, 3.0]))
    assert same is not None
    assert same.p_value == 1.0
    apart = compare_paired(np.array([2.0, 3.0]), np.array([1.0, 2.0]))
    assert apart is not None
    assert apart.p_value == 0.0


def test_pairing_tells_apart_what_the_luck_of_runs_hides():
    """The p-value of equal means is uniform: 2000 samples leave these bounds once in 100 (binomial)."""
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(2000):
        luck = rng.gamma(3.0, 1.0, 40)
        found = compare_paired(luck + rng.normal(0, 0.1, 40), luck + rng.normal(0, 0.1, 40))
        assert found is not None
        assert found.p_value is not None
        hits += found.p_value < 0.05
    low, high = stats.binom.interval(0.99, 2000, 0.05)
    assert low <= hits <= high
    luck = rng.gamma(3.0, 1.0, 40)
    better = luck - 0.1 + rng.normal(0, 0.1, 40)
    found = compare_paired(better, luck)
    assert found is not None
    assert found.p_value is not None
    unpaired: float = stats.ttest_ind(better, luck)[1]  # pyright: ignore[reportAssignmentType]
    assert found.p_value < 1e-3 < unpaired
