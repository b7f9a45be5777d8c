"""Intervals that hold although a study is evaluated several times and stops when they are narrow enough.

A look is an evaluation of a study after a planned number of runs. If a 95 % interval is evaluated at looks after 100,
150, 225, ... runs until it is narrow, it contains the true value in fewer than 95 % of studies. Repeated confidence
intervals (Jennison and Turnbull 1989) are wider: with a probability of 95 %, they contain it at all looks at once.

The error probability of 5 % is divided among the K planned looks (error spending, Lan and DeMets 1983). Each look gets
the same share, because it is unknown at which look the study will stop. The looks are correlated, because later looks
contain the runs of earlier ones. The recursion of Armitage, McPherson and Rowe (1969) takes account of this: it follows
the density of the sum of the figures, a Brownian motion whose time is the number of runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import LEVEL

GROWTH = 1.5  # factor of the number of runs from look to look
GRID = 201  # points of the density between the boundaries; more points change the boundaries by less than 1e-6
FARTHEST = 9.0  # in standard deviations: the probability beyond is less than 1e-18


class Look(NamedTuple):
    """An evaluation of the first `runs` runs.

    Attributes:
        runs: number of runs.
        number: number of the look, from 1.
        of: number of planned looks.
        level: confidence level at which the ordinary interval is as wide as the repeated interval.
    """

    runs: int
    number: int
    of: int
    level: float


def plan_looks(first: int, most: int, alpha: float = 1 - LEVEL) -> tuple[Look, ...]:
    """Return the looks of a study at the numbers of runs `growing(first, most)`.

    `alpha` is the probability that any of the intervals misses the true value.
    """
    counts = growing(first, most)
    levels = [1 - 2 * _tail(bound) for bound in boundaries(tuple(counts), alpha)]
    return tuple(
        Look(runs, number, len(counts), level)
        for number, (runs, level) in enumerate(zip(counts, levels, strict=True), start=1)
    )


def growing(first: int, most: int) -> list[int]:
    """Return numbers of runs from `first` to `most`, each GROWTH times the number before; the last is `most`."""
    counts = [min(first, most)]
    while counts[-1] < most:
        counts.append(min(math.ceil(GROWTH * counts[-1]), most))
    return counts


def repeated_p_value(looks: Sequence[Look], look: Look, p_value: float) -> float:
    """Return the p-value that holds at all looks at once.

    It is the largest error probability at which the repeated interval of this look contains the tested value.

    Args:
        looks: all planned looks.
        look: look at which the test is made.
        p_value: p-value of the ordinary two-sided test of the runs at `look`.
    """
    from scipy.special import ndtri  # here: scipy is slow to start

    counts = tuple(each.runs for each in looks)
    if p_value <= 2 * _tail(FARTHEST):
        return 0.0
    z = -float(ndtri(p_value / 2))
    low, high = 1e-9, 1.0 - 1e-9
    if boundaries(counts, high)[look.number - 1] > z:
        return 1.0
    for _ in range(26):  # in the logarithm: to a relative 1e-6
        middle = math.sqrt(low * high)
        low, high = (middle, high) if boundaries(counts, middle)[look.number - 1] > z else (low, middle)
    return high


@lru_cache(maxsize=256)
def boundaries(counts: tuple[int, ...], alpha: float) -> tuple[float, ...]:
    """Return the half-widths (K,) of repeated intervals in standard errors, for looks at `counts` (K,) runs.

    For independent normal figures, at least one of the K intervals misses the true mean with probability `alpha`. The
    probability that look k is the first to miss it is `alpha` / K for every k.
    """
    times = np.array(counts) / counts[-1]
    share = alpha / len(counts)
    found = [_root(lambda bound: 2 * _tail(bound) - share)]
    points = np.linspace(-1.0, 1.0, GRID) * found[0] * math.sqrt(times[0])
    density = np.exp(-(points**2) / (2 * times[0])) / math.sqrt(2 * math.pi * times[0])
    for before, now in pairwise(times):
        weights = density * _simpson(points)
        spread = math.sqrt(now - before)
        bound = _root(lambda z, w=weights, p=points, s=spread, t=now: _leaves(z * math.sqrt(t), w, p, s) - share)
        found.append(bound)
        wider = np.linspace(-1.0, 1.0, GRID) * bound * math.sqrt(now)
        steps = np.exp(-(((wider[:, None] - points) / spread) ** 2) / 2) / (math.sqrt(2 * math.pi) * spread)
        points, density = wider, steps @ weights
    return tuple(found)


def _leaves(bound: float, weights: Float, points: Float, spread: float) -> float:
    """Return the probability that a Brownian motion is outside ±bound after its next step.

    Before the step it is at one of `points` with the probabilities `weights`. The standard deviation of the step is
    `spread`.
    """
    from scipy.special import ndtr  # here: scipy is slow to start

    return float(weights @ (ndtr((points - bound) / spread) + ndtr((-bound - points) / spread)))


def _simpson(points: Float) -> Float:
    """Return the weights of Simpson's rule on an odd number of equally spaced points."""
    weights = np.full(len(points), 2.0)
    weights[1::2] = 4.0
    weights[[0, -1]] = 1.0
    return weights * (points[1] - points[0]) / 3


def _root(excess: Callable[[float], float]) -> float:
    """Return the zero of a decreasing function between 0 and FARTHEST, by bisection."""
    low, high = 0.0, FARTHEST
    for _ in range(36):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _tail(bound: float) -> float:
    """Return the probability that a standard normal variable exceeds `bound`."""
    return math.erfc(bound / math.sqrt(2)) / 2
