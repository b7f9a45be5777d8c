"""Intervals of a mean that hold at every number of runs at once, for any distribution, by betting.

A bet of a fixed share on figures x above m multiplies the wealth by 1 + share * (x - m) / limit at every run. If the
mean is at most m, the expected wealth does not grow, and reaches a threshold w at any time with probability 1/w at most
(Ville 1939). This needs no plan of looks, no normal distribution and no variance. The best share is unknown, so the
wealth is spread evenly over several. The interval contains all m whose bets stay below the threshold (Waudby-Smith and
Ramdas 2024, *Estimating means of bounded random variables by betting*).

Bets need bounded figures. A run counts as at most `limit` away; the location is then Huber's (1964): the point where
the limited deviations above and below balance, which is the plain mean unless a run is farther off.

Student's intervals are shorter, but wrong for a filter that diverges in a few of the runs: mean and spread of the first
runs without divergence do not show it. (`sequential` has intervals of that kind, for ratios of means.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np

from slamgauge.arrays import Float

SHARES = 0.9 * 0.5 ** np.arange(6)  # from bold to cautious: the smaller an effect, the smaller its best share
POWER = 0.9  # probability of finding an effect of `smallest_effect`
_POWER_SIGMA = NormalDist().inv_cdf(POWER)  # a normal variable exceeds its mean minus this many sigmas with POWER


def log_wealth(values: Float, limit: float) -> float:
    """Return the logarithm of the wealth of bets that the location of `values` (R,) is above zero, from 1."""
    return _pooled(growth_of(values, limit).sum(axis=1))


def location(values: Float, limit: float) -> float:
    """Return the mean of `values` (R,), each limited to at most `limit` from it."""
    return _last(
        lambda m: float(np.clip(values - m, -limit, limit).sum()) >= 0.0, float(values.min()), float(values.max())
    )


def lower_end(values: Float, limit: float, log_threshold: float) -> float:
    """Return the largest m at which bets on more have reached the threshold; -infinity if there are too few runs.

    It exceeds the location of the distribution of `values` (R,) with probability exp(-log_threshold) at most, at all R
    at once.
    """
    lowest = float(values.min()) - limit
    if log_wealth(values - lowest, limit) < log_threshold:
        return -math.inf
    return _last(lambda m: log_wealth(values - m, limit) >= log_threshold, lowest, float(values.max()))


def upper_end(values: Float, limit: float, log_threshold: float) -> float:
    """Return the smallest m at which bets on less have reached the threshold, or infinity."""
    return -lower_end(-values, limit, log_threshold)


def smallest_effect(values: Float, limit: float, log_threshold: float, runs: int) -> float:
    """Return the distance of a location from m at which bets reach the threshold with POWER after `runs` runs.

    Further runs are assumed to scatter like `values` (R,). Infinite if this number of runs cannot reach it.
    """
    centred = values - location(values, limit)
    return max(_smallest_above(each, limit, log_threshold, runs) for each in (centred, -centred))


def _smallest_above(centred: Float, limit: float, log_threshold: float, runs: int) -> float:
    def too_small(effect: float) -> bool:
        growth = growth_of(centred + effect, limit)
        unlucky = runs * growth.mean(axis=1) - _POWER_SIGMA * math.sqrt(runs) * growth.std(axis=1)
        return _pooled(unlucky) < log_threshold

    largest = limit - float(centred.min())
    return math.inf if too_small(largest) else _last(too_small, 0.0, largest)


def growth_of(values: Float, limit: float) -> Float:
    """Return the growth (S, R) of the logarithm of wealth at each run, for each of the shares."""
    return np.log1p(SHARES[:, None] * np.clip(values / limit, -1.0, 1.0))


def _pooled(log_wealths: Float) -> float:
    """Return the logarithm of the mean of wealths, from their logarithms (S,)."""
    most = float(log_wealths.max())
    return most + math.log(float(np.exp(log_wealths - most).mean()))


def _last(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return where a condition that holds at `low` ceases to hold, by bisection."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
