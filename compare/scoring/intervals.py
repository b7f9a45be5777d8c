"""Intervals over independent runs, 95 % if not told: of a mean, a ratio of paired means, any figure of all runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.nan_stats import number

LEVEL = 0.95


class Interval(NamedTuple):
    """An estimate and its interval; the interval is None for a single run."""

    mean: float
    low: float | None
    high: float | None


def mean_interval(values: Float, level: float = LEVEL) -> Interval | None:
    """Student's interval of the mean of the entries that are not NaN; None if there are none."""
    values = values[~np.isnan(values)]
    if not len(values):
        return None
    spread = float(values.std(ddof=1)) if len(values) > 1 else np.nan
    return _around(float(values.mean()), spread, len(values), level)


def ratio_interval(numerator: Float, denominator: Float, level: float = LEVEL) -> Interval | None:
    """Interval of mean / mean over the same runs, to first order (the delta method); NaN pairs are left out."""
    both = ~np.isnan(numerator) & ~np.isnan(denominator)
    above, below = numerator[both], denominator[both]
    if not len(above) or below.mean() <= 0:
        return None
    ratio = float(above.mean() / below.mean())
    spread = float((above - ratio * below).std(ddof=1) / below.mean()) if len(above) > 1 else np.nan
    return _around(ratio, spread, len(above), level)


def jackknife_interval(figure: Callable[[Float, int], Float], totals: Float) -> Interval | None:
    """Interval of a figure that is a function of sums over runs.

    Args:
        figure: (..., n) sums over `count` runs -> (...) figures.
        totals: (R, n) what each run contributes to the sums.
    """
    runs = len(totals)
    if not runs:
        return None
    whole = totals.sum(axis=0)
    value = float(figure(whole, runs))
    if runs == 1:
        return _around(value, np.nan, 1)
    without = figure(whole - totals, runs - 1)
    return _around(value, float(np.sqrt((runs - 1) * np.square(without - without.mean()).sum())), runs)


def bootstrap_interval(values: Float, seed: int = 0, resamples: int = 10_000) -> Interval:
    """Percentile interval of the mean of `values` (R,) over runs drawn with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(0, len(values), (resamples, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    single = len(values) == 1
    return Interval(float(values.mean()), None if single else float(low), None if single else float(high))


def _around(mean: float, spread: float, runs: int, level: float = LEVEL) -> Interval:
    """The mean and its Student interval for a standard deviation `spread` over `runs` runs."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    half = stdtrit(runs - 1, (1 + level) / 2) * spread / np.sqrt(runs) if runs > 1 else np.nan
    return Interval(mean, number(mean - half), number(mean + half))
