"""Intervals of a mean that hold at every number of runs at once, whatever the distribution: by bets against it.

Someone who bets, run after run, a fixed share of what they have that a figure x is above m, and is paid as much as it
is, has after n runs the product of 1 + share * (x - m) / limit. If the mean is at most m, this wealth is not expected
to grow, and reaches a threshold w at any time with probability 1/w at most (Ville 1939): no plan of looks, no normal
distribution and no variance enters. Which share pays best is not known; the wealth is spread evenly over several.
The interval is made of all m that leave poor (Waudby-Smith and Ramdas 2024, *Estimating means of bounded random
variables by betting*).

Bets need bounded figures. A run counts as at most `limit` away, and the mean is where what lies above and what lies
below balance under that rule: Huber's (1964) location, the plain mean unless a run is farther off.

Student's intervals would be shorter, and wrong where a filter loses itself in some of the runs: a few runs without
such a one have a mean and a spread that say nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np

from slamgauge.arrays import Float

SHARES = 0.9 * 0.5 ** np.arange(6)  # from bold to cautious: the smaller an effect, the smaller the share that pays best
POWER = 0.9  # with which an effect is found that is said to be
_POWER_SIGMA = NormalDist().inv_cdf(POWER)  # a normal variable is above its mean less so many sigmas with POWER


def log_wealth(values: Float, limit: float) -> float:
    """Logarithm of what bets that the location of `values` (R,) is above zero have made of 1."""
    return _pooled(growth_of(values, limit).sum(axis=1))


def location(values: Float, limit: float) -> float:
    """The mean of `values` (R,), each at most `limit` from it."""
    return _last(
        lambda m: float(np.clip(values - m, -limit, limit).sum()) >= 0.0, float(values.min()), float(values.max())
    )


def lower_end(values: Float, limit: float, log_threshold: float) -> float:
    """The largest m at which bets on more have reached the threshold; -infinity where so few runs cannot.

    It is above the location of what `values` (R,) are drawn from with probability exp(-log_threshold) at most, at all R
    at once.
    """
    lowest = float(values.min()) - limit
    if log_wealth(values - lowest, limit) < log_threshold:
        return -math.inf
    return _last(lambda m: log_wealth(values - m, limit) >= log_threshold, lowest, float(values.max()))


def upper_end(values: Float, limit: float, log_threshold: float) -> float:
    """The smallest m at which bets on less have reached the threshold, likewise."""
    return -lower_end(-values, limit, log_threshold)


def smallest_effect(values: Float, limit: float, log_threshold: float, runs: int) -> float:
    """How far a location must be from m, to either side, for bets to reach the threshold with POWER after so many runs.

    The runs to come are taken to scatter as `values` (R,) do. It is infinite where so few runs never reach it.
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
    """By how much the logarithm of wealth grows with each run (S, R), for each of the shares."""
    return np.log1p(SHARES[:, None] * np.clip(values / limit, -1.0, 1.0))


def _pooled(log_wealths: Float) -> float:
    """Logarithm of the mean of wealths whose logarithms (S,) are these."""
    most = float(log_wealths.max())
    return most + math.log(float(np.exp(log_wealths - most).mean()))


def _last(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Up to where something holds that holds at `low` and, from some point on, no more; by bisection."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
