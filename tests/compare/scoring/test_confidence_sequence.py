"""Intervals by betting: they hold at every number of runs, also if Student's do not, and have the stated power."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from slamgauge.arrays import Float
from slamgauge.compare.scoring.confidence_sequence import (
    POWER,
    SHARES,
    location,
    log_wealth,
    lower_end,
    smallest_effect,
    upper_end,
)
from slamgauge.compare.scoring.sequential import plan_looks

LIMIT = math.log(10.0)
RARE, OFTEN = -0.9, 0.1  # figures of one run of ten, and of the others: mean zero


def rarely_diverged(rng: np.random.Generator, *shape: int) -> Float:
    """Return figures of mean zero: a filter diverges in one run of ten."""
    return np.where(rng.random(shape) < 0.1, RARE, OFTEN)


def test_bets_on_figures_of_mean_zero_are_fair():
    """The expected wealth over all outcomes of eight runs is 1, in both directions."""
    for sign in (1.0, -1.0):
        expected = 0.0
        for outcome in itertools.product((RARE, OFTEN), repeat=8):
            probability = math.prod(0.1 if each == RARE else 0.9 for each in outcome)
            expected += probability * math.exp(log_wealth(sign * np.array(outcome), LIMIT))
        assert expected == pytest.approx(1.0, abs=1e-12)


def test_wealth_is_the_mean_over_shares():
    values = np.array([0.5, -0.2, 30.0])
    made = [(1 + f * 0.5 / 2.0) * (1 - f * 0.2 / 2.0) * (1 + f) for f in SHARES]  # the last is limited
    assert log_wealth(values, 2.0) == pytest.approx(math.log(np.mean(made)))


def test_the_false_alarm_rate_at_any_time_is_as_stated_and_that_of_students_looks_is_not():
    """2000 studies without an effect, up to 300 runs, 2.5 %, upper 99.9 % binomial bound.

    Student's test at looks after 20, 30, 45, ... runs is that of `scoring.sequential`, right for normal figures.
    """
    trials, most = 2000, 300
    values = rarely_diverged(np.random.default_rng(0), trials, most)
    made = np.log1p(SHARES[:, None, None] * values / -RARE).cumsum(axis=2)
    ever = (np.exp(made).mean(axis=0) >= 40.0).any(axis=1)
    assert np.exp(made[:, 7, -1]).mean() == pytest.approx(math.exp(log_wealth(values[7], -RARE)))
    bound = stats.binom.ppf(0.999, trials, 0.025)
    assert 0 < ever.sum() <= bound
    wrong = np.zeros(trials, bool)
    for look in plan_looks(20, most):  # 2.5 % on either side
        seen = values[:, : look.runs]
        with np.errstate(divide="ignore"):
            t = math.sqrt(look.runs) * seen.mean(axis=1) / seen.std(axis=1, ddof=1)
        wrong |= t > stats.t.ppf((1 + look.level) / 2, look.runs - 1)
    assert wrong.sum() > bound


def test_bets_reach_the_threshold_at_the_ends():
    values = np.random.default_rng(1).normal(0.3, 0.4, 200)
    low, high = lower_end(values, LIMIT, 5.0), upper_end(values, LIMIT, 5.0)
    assert log_wealth(values - low, LIMIT) == pytest.approx(5.0, abs=1e-6)
    assert log_wealth(high - values, LIMIT) == pytest.approx(5.0, abs=1e-6)
    assert low < location(values, LIMIT) < high
    assert lower_end(values, LIMIT, 9.0) < low < high < upper_end(values, LIMIT, 9.0)


def test_a_few_runs_have_no_finite_interval():
    enough = math.ceil((5.0 + math.log(len(SHARES))) / math.log(1 + SHARES[0]))  # if only the boldest share gained
    assert math.isinf(lower_end(np.full(4, 100.0), LIMIT, 5.0))
    assert math.isfinite(lower_end(np.full(enough, 100.0), LIMIT, 5.0))
    assert math.isinf(smallest_effect(np.zeros(4), LIMIT, 5.0, 4))


def test_the_location_is_the_mean_unless_a_run_is_beyond_the_limit():
    values = np.array([0.0, 1.0, 2.0, 1.4])
    assert location(values, 2.0) == pytest.approx(1.1)
    diverged = np.array([0.0, 1.0, 2.0, 1e6])
    assert location(diverged, 2.0) == pytest.approx(5.0 / 3.0)  # sum of (x - m) over three, and the limit of 2
    assert location(np.full(3, 0.7), 2.0) == pytest.approx(0.7)


def test_power_is_as_stated():
    """Of 1000 studies at the smallest effect 90 % reach the threshold (two-sided 0.999 binomial bounds).

    Skewed figures need effects of different sizes above and below; `smallest_effect` is the larger one.
    """
    rng, runs, trials, threshold = np.random.default_rng(2), 400, 1000, 6.0
    effect = smallest_effect(np.where(np.arange(1000) < 100, RARE, OFTEN), LIMIT, threshold, runs)
    drawn = rarely_diverged(rng, trials, runs)
    found = [sum(log_wealth(sign * each + effect, LIMIT) >= threshold for each in drawn) for sign in (1.0, -1.0)]
    low, high = stats.binom.interval(0.999, trials, POWER)
    assert low <= min(found) <= high
