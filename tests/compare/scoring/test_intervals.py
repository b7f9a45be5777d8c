"""Intervals against textbook formulas and, where there is none, against their coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import bootstrap_interval, jackknife_interval, mean_interval, ratio_interval


def test_the_mean_has_students_interval_and_leaves_gaps_out() -> None:
    values = np.array([1.0, 2.0, np.nan, 4.0, 7.0])
    interval = mean_interval(values)
    assert interval is not None
    known = values[~np.isnan(values)]
    low, high = stats.t.interval(0.95, 3, loc=known.mean(), scale=stats.sem(known))
    assert interval == pytest.approx((3.5, low, high))


def test_a_single_run_has_no_interval_and_nothing_has_no_mean() -> None:
    assert mean_interval(np.array([2.0])) == (2.0, None, None)
    assert mean_interval(np.array([np.nan])) is None
    assert ratio_interval(np.array([np.nan]), np.array([1.0])) is None
    assert jackknife_interval(lambda sums, count: sums.sum(axis=-1) / count, np.zeros((0, 1))) is None


def test_the_jackknife_of_a_mean_is_students_interval() -> None:
    values = np.random.default_rng(0).normal(3.0, 2.0, 30)
    jackknife = jackknife_interval(lambda sums, count: sums[..., 0] / count, values[:, None])
    assert jackknife == pytest.approx(mean_interval(values))


def test_a_ratio_of_proportional_figures_is_exact() -> None:
    below = np.array([1.0, 2.0, 5.0])
    assert ratio_interval(3 * below, below) == pytest.approx((3.0, 3.0, 3.0))


def test_the_95_percent_intervals_hold_the_true_figure_95_times_in_100() -> None:
    """1000 samples of 300 runs; a coverage of 95 % leaves these bounds once in 100 (binomial)."""
    rng = np.random.default_rng(1)
    hits = {"ratio": 0, "jackknife": 0, "bootstrap": 0}
    for _ in range(1000):
        below = rng.gamma(4.0, 0.25, 300)
        above = 1.5 * below * rng.gamma(25.0, 0.04, 300)
        values = rng.normal(2.0, 1.0, 300)
        intervals = {
            "ratio": (ratio_interval(above, below), 1.5),
            "jackknife": (jackknife_interval(root_mean, values[:, None] ** 2), np.sqrt(5.0)),
            "bootstrap": (bootstrap_interval(values, resamples=1000), 2.0),
        }
        for name, (interval, true) in intervals.items():
            assert interval is not None
            assert interval.low is not None
            assert interval.high is not None
            hits[name] += interval.low <= true <= interval.high
    low, high = stats.binom.interval(0.99, 1000, 0.95)
    for name, count in hits.items():
        assert low <= count <= high, name


def root_mean(sums: Float, count: int) -> Float:
    return np.sqrt(sums[..., 0] / count)
