"""Means of figures, intervals over independent runs, and comparisons of two estimators on the same runs.

An undefined figure is NaN in arrays; for an undefined result functions return None.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float

LEVEL = 0.95  # probability of intervals, if no other is given
ROUNDING = 1e-9  # m, rad: errors and sigmas of an optimum below this are rounding, so nothing is divided by them
WORTH = 0.05  # least relative deviation that is stated, and the precision that a study should reach


def number(value: float) -> float | None:
    """Return `value` as a Python float, or None if it is NaN or infinite."""
    return float(value) if math.isfinite(value) else None


def defined_mean(values: Float) -> float:
    """Return the mean of the entries that are not NaN, which may be infinite; NaN without entries."""
    values = values[~np.isnan(values)]
    return float(values.mean()) if values.size else math.nan


def mean(values: Float) -> float | None:
    """Return the mean of the entries that are not NaN; None without entries or if it is infinite."""
    return number(defined_mean(values))


def rms(values: Float) -> float | None:
    """Return the root mean square of the entries that are not NaN; None without entries or if it is infinite."""
    return number(math.sqrt(defined_mean(np.square(values))))


@dataclass(frozen=True)
class Interval:
    """A figure and its interval; a single run has no interval (None)."""

    mean: float
    low: float | None
    high: float | None

    @property
    def half_width(self) -> float | None:
        """Half the width of the interval."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2

    def is_above(self, bound: float) -> bool:
        """Return whether the whole interval is above a bound."""
        return self.low is not None and self.low > bound

    def is_below(self, bound: float) -> bool:
        """Return whether the whole interval is below a bound."""
        return self.high is not None and self.high < bound


def mean_interval(values: Float, level: float = LEVEL) -> Interval | None:
    """Return Student's interval of the mean of the entries that are not NaN; None without entries."""
    values = values[~np.isnan(values)]
    return _around(float(values.mean()), half_widths(values, level)) if len(values) else None


def ratio_interval(numerator: Float, denominator: Float, level: float = LEVEL) -> Interval | None:
    """Return the interval of mean / mean over the same runs, to first order (delta method), without NaN pairs.

    Return None if the mean denominator is not above ROUNDING.
    """
    both = ~np.isnan(numerator) & ~np.isnan(denominator)
    above, below = numerator[both], denominator[both]
    if not len(above) or below.mean() <= ROUNDING:
        return None
    ratio = float(above.mean() / below.mean())
    return _around(ratio, half_widths(above - ratio * below, level) / below.mean())


def jackknife_interval(figure: Callable[[Float, int], Float], totals: Float) -> Interval | None:
    """Return the interval of a `figure` of sums (..., n) over a number of runs, which contribute `totals` (R, n)."""
    runs, whole = len(totals), totals.sum(axis=0)
    if not runs:
        return None
    half = half_widths((runs - 1) * figure(whole - totals, runs - 1)) if runs > 1 else math.nan
    return _around(float(figure(whole, runs)), half)


def bootstrap_interval(values: Float, seed: int = 0, resamples: int = 10_000) -> Interval:
    """Return the percentile interval of the mean of `values` (R,) over runs drawn with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(0, len(values), (resamples, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]).tolist() if len(values) > 1 else (None, None)
    return Interval(float(values.mean()), low, high)


def half_widths(values: Float, level: float = LEVEL) -> Float:
    """Return half the width of Student's interval of the mean over runs, for values (R, ...); NaN for a single run."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    runs = len(values)
    if runs < 2:
        return np.full(values.shape[1:], np.nan)
    return stdtrit(runs - 1, (1 + level) / 2) * values.std(axis=0, ddof=1) / np.sqrt(runs)


def _around(middle: float, half: Float | float) -> Interval:
    return Interval(middle, number(float(middle - half)), number(float(middle + half)))


@dataclass(frozen=True)
class Paired:
    """Comparison of the means of two estimators on the same runs."""

    runs: int  # with both figures
    difference: Interval  # mean of the differences, first minus second, with Student's interval
    ratio: Interval | None  # `ratio_interval`
    p_value: float | None  # p-value of Student's two-sided paired test of equal means; None for a single run


def compare_paired(first: Float, second: Float, level: float = LEVEL) -> Paired | None:
    """Compare a figure (R,) of two estimators run by run: variation that runs share cancels in the difference.

    Pairs with NaN are left out; None if no run has both figures.
    """
    from scipy.special import stdtr  # here: scipy is slow to start

    differences = first - second
    difference = mean_interval(differences, level)
    if difference is None:
        return None
    differences = differences[~np.isnan(differences)]
    runs, p_value = len(differences), None
    if runs > 1:
        error = differences.std(ddof=1) / np.sqrt(runs)
        p_value = 2 * float(stdtr(runs - 1, -abs(difference.mean) / error)) if error else float(difference.mean == 0)
    return Paired(runs, difference, ratio_interval(first, second, level), p_value)


def needed_runs(ratio: Interval, runs: int) -> str:
    """Return how many runs a 95 % interval of ±WORTH needs, to two digits, for a ratio's interval over `runs` runs.

    Empty if `runs` are enough, or if the ratio has no interval.
    """
    needed = round(runs * ((ratio.half_width or 0.0) / WORTH) ** 2, 6)  # 400, not 400.0000001
    step = 10 ** max(0, math.floor(math.log10(max(needed, 1))) - 1)
    needed = math.ceil(needed / step) * step
    return f": about {needed} runs are needed to know it to {100 * WORTH:g} %" if needed > runs else ""
