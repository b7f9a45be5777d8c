"""Intervals and paired comparisons against textbook formulas, and by their coverage."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from scipy import stats

from slamgauge.compare.scoring.intervals import (
    Interval,
    Paired,
    bootstrap_interval,
    compare_paired,
    jackknife_interval,
    mean,
    mean_interval,
    ratio_interval,
)
from tests.reference.given import given


def ends(found: Interval | None) -> tuple[float | None, ...]:
    return astuple(given(found))


def test_the_mean_has_students_interval_without_gaps() -> None:
    values = np.array([1.0, 2.0, np.nan, 4.0, 7.0])
    known = values[~np.isnan(values)]
    low, high = stats.t.interval(0.95, 3, loc=known.mean(), scale=stats.sem(known))
    assert ends(mean_interval(values)) == pytest.approx((3.5, low, high))


def test_a_single_run_has_no_interval_and_no_run_has_no_mean() -> None:
    assert mean_interval(np.array([2.0])) == Interval(2.0, None, None)
    assert mean_interval(np.array([np.nan])) is None
    assert (mean(np.array([1.0, np.inf])), mean(np.array([1.0, np.nan]))) == (None, 1.0)
    assert ratio_interval(np.array([np.nan]), np.array([1.0])) is None
    assert ratio_interval(np.zeros(3), np.full(3, 1e-16)) is None  # errors of an optimum that are rounding
    assert jackknife_interval(lambda sums, count: sums.sum(axis=-1) / count, np.zeros((0, 1))) is None


def test_the_jackknife_of_a_mean_is_students_interval_and_a_ratio_of_proportional_figures_is_exact() -> None:
    values = np.random.default_rng(0).normal(3.0, 2.0, 30)
    jackknife = jackknife_interval(lambda sums, count: sums[..., 0] / count, values[:, None])
    assert ends(jackknife) == pytest.approx(ends(mean_interval(values)))
    assert ends(ratio_interval(3 * values, values)) == pytest.approx((3.0, 3.0, 3.0))


@pytest.mark.full  # a statistic of many samples
def test_95_percent_intervals_contain_the_true_figure_95_times_in_100() -> None:
    """1000 samples of 300 runs; a coverage of 95 % leaves these bounds once in 100 (binomial)."""
    rng = np.random.default_rng(1)
    hits = {"ratio": 0, "jackknife": 0, "bootstrap": 0}
    for _ in range(1000):
        below = rng.gamma(4.0, 0.25, 300)
        above = 1.5 * below * rng.gamma(25.0, 0.04, 300)
        values = rng.normal(2.0, 1.0, 300)
        intervals = {
            "ratio": (ratio_interval(above, below), 1.5),
            "jackknife": (
                jackknife_interval(lambda sums, count: np.sqrt(sums[..., 0] / count), values[:, None] ** 2),
                5**0.5,
            ),
            "bootstrap": (bootstrap_interval(values, resamples=1000), 2.0),
        }
        for name, (interval, true) in intervals.items():
            hits[name] += given(given(interval).low) <= true <= given(given(interval).high)
    low, high = stats.binom.interval(0.99, 1000, 0.95)
    assert all(low <= count <= high for count in hits.values()), hits


# --- paired comparisons --------------------------------------------------------------------------


def test_a_paired_comparison_is_students_test_of_the_complete_pairs() -> None:
    ours = np.array([1.0, 2.5, np.nan, 4.0, 7.0, 3.0])
    theirs = np.array([0.5, 2.0, 1.0, 3.0, 7.5, np.nan])
    found, whole = given(compare_paired(ours, theirs, level=0.9)), [0, 1, 3, 4]
    assert found.runs == 4
    assert ends(found.difference) == ends(mean_interval((ours - theirs)[whole], 0.9))
    assert found.p_value == pytest.approx(stats.ttest_rel(ours[whole], theirs[whole])[1])
    assert found.ratio == ratio_interval(ours, theirs, 0.9)


def test_a_paired_comparison_of_few_or_equal_pairs() -> None:
    assert compare_paired(np.array([np.nan, 1.0]), np.array([1.0, np.nan])) is None
    single = compare_paired(np.array([2.0]), np.array([1.0]))
    assert single == Paired(1, Interval(1.0, None, None), Interval(2.0, None, None), None)
    ours = np.array([2.0, 3.0])
    assert [given(compare_paired(ours, ours - less)).p_value for less in (0.0, 1.0)] == [1.0, 0.0]
