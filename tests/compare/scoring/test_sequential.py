"""Repeated confidence intervals: boundaries against closed forms, and coverage over all looks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from slamgauge.compare.scoring.intervals import Interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.sequential import Look, boundaries, plan_looks, repeated_p_value


def test_each_look_spends_the_same_share_of_the_error():
    """Paths of a Brownian motion leave each boundary first with 1 % (0.999 binomial bounds over five looks)."""
    rng = np.random.default_rng(0)
    paths, counts = 400_000, (10, 20, 30, 60, 100)
    steps = rng.standard_normal((paths, len(counts))) * np.sqrt(np.diff((0, *counts)))
    z = np.cumsum(steps, axis=1) / np.sqrt(counts)
    outside = np.abs(z) > boundaries(counts, 0.05)
    first = np.where(outside.any(axis=1), outside.argmax(axis=1), len(counts))
    low, high = stats.binom.interval(0.999, paths, 0.01)
    assert all(low <= np.sum(first == look) <= high for look in range(len(counts)))


def test_two_equal_looks_agree_with_the_bivariate_normal():
    first, second = boundaries((50, 100), 0.05)
    assert first == pytest.approx(-stats.norm.ppf(0.0125), abs=1e-8)
    both = stats.multivariate_normal(cov=np.array([[1, np.sqrt(0.5)], [np.sqrt(0.5), 1]]))
    inside = both.cdf([first, second], lower_limit=[-first, -second])
    assert inside == pytest.approx(0.95, abs=1e-5)


def test_one_look_is_a_fixed_number_of_runs():
    (look,) = plan_looks(200, 100)
    assert look == (100, 1, 1, pytest.approx(0.95))
    assert repeated_p_value((look,), look, 0.03) == pytest.approx(0.03, rel=1e-4)


def test_looks_grow_up_to_the_limit():
    looks = plan_looks(20, 200)
    assert [look.runs for look in looks] == [20, 30, 45, 68, 102, 153, 200]
    assert [look.number for look in looks] == [1, 2, 3, 4, 5, 6, 7]
    assert all(0.98 < look.level < 0.995 for look in looks)


def test_a_study_that_ends_when_its_interval_is_narrow_contains_the_truth():
    """All looks hold in 95 % (two-sided 0.99 binomial bounds), so the last one holds at least as often.

    Intervals of a fixed number of runs do not.
    """
    rng = np.random.default_rng(5)
    looks, trials = plan_looks(100, 600), 3000
    always, ended, fixed = 0, [], 0
    for _ in range(trials):
        values = rng.normal(1.0, 2.0, 600)
        found = [(look, mean_interval(values[: look.runs], look.level)) for look in looks]
        plain = [mean_interval(values[: look.runs]) for look in looks]
        holds = {look.number: holds_one(interval) for look, interval in found}
        always += all(holds.values())
        fixed += all(map(holds_one, plain))
        stop = next((look for look, each in found if np.diff(ends(each)).item() < 0.4), looks[-1])
        ended.append((stop.number, holds[stop.number]))
    low, high = stats.binom.interval(0.99, trials, 0.95)
    assert low <= always <= high
    assert fixed < low
    assert len({number for number, _ in ended}) > 1
    assert sum(held for _, held in ended) >= low


def test_ratios_of_errors_that_last_hold_at_all_looks_from_twenty_runs_on():
    """Rayleigh-distributed ATEs of an optimum and of a worse filter: 95 % (0.99 binomial bounds)."""
    rng = np.random.default_rng(0)
    looks, trials = plan_looks(20, 200), 1500
    best = rng.standard_normal((trials, 2, 200))
    worse = best + 0.75 * rng.standard_normal(best.shape)
    optimum, ours = np.hypot(best[:, 0], best[:, 1]), np.hypot(worse[:, 0], worse[:, 1]) / 1.25
    held = 0
    for above, below in zip(ours, optimum, strict=True):
        held += all(holds_one(ratio_interval(above[: n.runs], below[: n.runs], n.level)) for n in looks)
    low, high = stats.binom.interval(0.99, trials, 0.95)
    assert low <= held <= high


def ends(interval: Interval | None) -> tuple[float, float]:
    assert interval is not None and interval.low is not None and interval.high is not None
    return interval.low, interval.high


def holds_one(interval: Interval | None) -> bool:
    low, high = ends(interval)
    return low <= 1.0 <= high


def test_a_repeated_p_value_is_small_if_the_repeated_interval_excludes_zero():
    looks = plan_looks(10, 100)
    for look in looks:
        at_the_edge = 1 - look.level
        assert repeated_p_value(looks, look, at_the_edge) == pytest.approx(0.05, rel=1e-4)
        assert repeated_p_value(looks, look, at_the_edge / 2) < 0.05 < repeated_p_value(looks, look, at_the_edge * 2)
    assert repeated_p_value(looks, looks[1], 0.0) == 0.0
    assert repeated_p_value(looks, looks[1], 1.0) == 1.0
    assert isinstance(looks[0], Look)
