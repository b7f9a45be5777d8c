"""Intervals over independent runs, by default 95 %: means, ratios of means, figures of all runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.nan_stats import number

LEVEL = 0.95
ROUNDING = 1e-9  # m, rad: errors and sigmas of an optimum below this are rounding, so nothing is divided by them


@dataclass(frozen=True)
class Interval:
    """A figure and its interval; a single run has no interval (None)."""

    mean: float
    low: float | None
    high: float | None


def mean_interval(values: Float, level: float = LEVEL) -> Interval | None:
    """Return Student's interval of the mean of the entries that are not NaN; None without entries."""
    values = values[~np.isnan(values)]
    if not len(values):
        return None
    spread = float(values.std(ddof=1)) if len(values) > 1 else np.nan
    return _around(float(values.mean()), spread, len(values), level)


def ratio_interval(numerator: Float, denominator: Float, level: float = LEVEL) -> Interval | None:
    """Return the interval of mean / mean over the same runs, to first order (delta method), without NaN pairs.

    The result is None if the mean denominator is not above ROUNDING.
    """
    both = ~np.isnan(numerator) & ~np.isnan(denominator)
    above, below = numerator[both], denominator[both]
    if not len(above) or below.mean() <= ROUNDING:
        return None
    ratio = float(above.mean() / below.mean())
    spread = float((above - ratio * below).std(ddof=1) / below.mean()) if len(above) > 1 else np.nan
    return _around(ratio, spread, len(above), level)


def jackknife_interval(figure: Callable[[Float, int], Float], totals: Float) -> Interval | None:
    """Return the interval of a figure that is a function of sums over runs.

    Args:
        figure: maps (..., n) sums over `count` runs to (...) figures.
        totals: (R, n) contribution of each run to the sums.
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
    """Return the percentile interval of the mean of `values` (R,) over runs drawn with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(0, len(values), (resamples, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    single = len(values) == 1
    return Interval(float(values.mean()), None if single else float(low), None if single else float(high))


def half_widths(values: Float, level: float = LEVEL) -> Float:
    """Return half the width of Student's interval of the mean over runs, for values (R, n); NaN for a single run."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    runs = len(values)
    if runs < 2:
        return np.full(values.shape[1], np.nan)
    return stdtrit(runs - 1, (1 + level) / 2) * values.std(axis=0, ddof=1) / np.sqrt(runs)


def _around(mean: float, spread: float, runs: int, level: float = LEVEL) -> Interval:
    """Return the mean and its Student interval for a standard deviation `spread` over `runs` runs."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    half = stdtrit(runs - 1, (1 + level) / 2) * spread / np.sqrt(runs) if runs > 1 else np.nan
    return Interval(mean, number(mean - half), number(mean + half))
