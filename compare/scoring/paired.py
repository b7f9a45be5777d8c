"""Comparison of two estimators on the same runs: differences and ratios, bounds on a ratio, and the runs it needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import LEVEL, Interval, mean_interval, ratio_interval

WORTH = 0.05  # least relative deviation that is stated, and the precision that a study should reach
NORMAL = 1.959964  # standard deviations of a 95 % interval


@dataclass(frozen=True)
class Paired:
    """Comparison of the means of two estimators on the same runs.

    Attributes:
        runs: number of runs with both figures.
        difference: mean of the differences, first minus second, with Student's interval.
        ratio: mean over mean, with the delta method's interval; None unless the second mean is above ROUNDING.
        p_value: p-value of Student's two-sided paired test of equal means; None for a single run.
    """

    runs: int
    difference: Interval
    ratio: Interval | None
    p_value: float | None


def compare_paired(first: Float, second: Float, level: float = LEVEL) -> Paired | None:
    """Compare a figure of two estimators run by run: variation that runs share cancels in the difference.

    Args:
        first: (R,) figures of the runs; pairs with NaN are left out.
        second: (R,) figures of the same runs.
        level: probability of both intervals.

    Returns:
        None if no run has both figures.
    """
    both = ~np.isnan(first) & ~np.isnan(second)
    differences = (first - second)[both]
    difference = mean_interval(differences, level)
    if difference is None:
        return None
    return Paired(len(differences), difference, ratio_interval(first, second, level), _p_value(differences))


def _p_value(differences: Float) -> float | None:
    """Return the p-value of Student's two-sided test that the mean of (R,) is zero."""
    from scipy.special import stdtr  # here: scipy is slow to start

    runs = len(differences)
    if runs < 2:
        return None
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    if spread == 0:
        return 1.0 if mean == 0 else 0.0
    return 2 * float(stdtr(runs - 1, -abs(mean) / spread * np.sqrt(runs)))


def is_above(ratio: Interval | None, bound: float) -> bool:
    """Return whether the whole interval of a ratio is above a bound."""
    return ratio is not None and ratio.low is not None and ratio.low > bound


def is_below(ratio: Interval | None, bound: float) -> bool:
    """Return whether the whole interval of a ratio is below a bound."""
    return ratio is not None and ratio.high is not None and ratio.high < bound


def runs_to_resolve(scatter: float) -> int:
    """Return the runs until a 95 % interval is ±WORTH, for a standard deviation `scatter` between runs; two digits."""
    runs = round((NORMAL * scatter / WORTH) ** 2, 6)  # 400, not 400.0000001
    step = 10 ** max(0, math.floor(math.log10(max(runs, 1))) - 1)
    return math.ceil(runs / step) * step


def needed_runs(ratio: Interval, runs: int) -> str:
    """Return how many runs a 95 % interval of ±WORTH needs, for the interval of a ratio over `runs` runs.

    Empty if `runs` are enough, or if the ratio has no interval.
    """
    if ratio.low is None or ratio.high is None:
        return ""
    needed = runs_to_resolve((ratio.high - ratio.low) / 2 / NORMAL * math.sqrt(runs))
    return f": about {needed} runs are needed to know it to {100 * WORTH:g} %" if needed > runs else ""
