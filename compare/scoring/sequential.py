"""Intervals that hold although a study is evaluated several times and stops when they are narrow enough.

A 95 % interval that is evaluated after 100 runs, 150, 225 and so on, until it is narrow, is right less often than 95 %.
Repeated confidence intervals (Jennison and Turnbull 1989) hold at all looks at once with that probability. The error is
spent as by Lan and DeMets (1983), with the same share at every look, since the last look is unknown in advance. The
correlation of the looks follows from the recursion of Armitage, McPherson and Rowe (1969) over the score process, a
Brownian motion at the times of the looks.
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
    """A look at the first `runs` runs: number `number` of at most `of`, from 1.

    `level` is the probability for which the interval of a fixed number of runs equals the repeated one.
    """

    runs: int
    number: int
    of: int
    level: float


def plan_looks(first: int, most: int) -> tuple[Look, ...]:
    """Return the looks of a study: at `first` runs, GROWTH times as many, ..., and at `most`."""
    counts = growing(first, most)
    levels = [1 - 2 * _tail(bound) for bound in boundaries(tuple(counts), 1 - LEVEL)]
    return tuple(
        Look(runs, number, len(counts), level)
        for number, (runs, level) in enumerate(zip(counts, levels, strict=True), start=1)
    )


def growing(first: int, most: int) -> list[int]:
    """Return numbers of runs: `first`, GROWTH times as many, ..., and `most`."""
    counts = [min(first, most)]
    while counts[-1] < most:
        counts.append(min(math.ceil(GROWTH * counts[-1]), most))
    return counts


def repeated_p_value(looks: Sequence[Look], look: Look, p_value: float) -> float:
    """Return the p-value that holds at all looks at once, from that of a fixed number of runs at `look`.

    It is the largest error probability at which the repeated interval of this look contains the tested value.
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

    The mean of independent normal figures leaves any of the intervals with probability `alpha`, and leaves each of them
    first with the same share of `alpha`.
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
    """Return the probability that a step of standard deviation `spread` from weighted `points` ends outside ±bound."""
    from scipy.special import ndtr  # here: scipy is slow to start

    return float(weights @ (ndtr((points - bound) / spread) + ndtr((-bound - points) / spread)))


def _simpson(points: Float) -> Float:
    """Return the weights of Simpson's rule on an odd number of equally spaced points."""
    weights = np.full(len(points), 2.0)
    weights[1::2] = 4.0
    weights[[0, -1]] = 1.0
    return weights * (points[1] - points[0]) / 3


def _root(excess: Callable[[float], float]) -> float:
    """Return the zero of a falling function of a boundary, by bisection."""
    low, high = 0.0, FARTHEST
    for _ in range(36):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def _tail(bound: float) -> float:
    """Return the probability that a normal variable exceeds `bound`."""
    return math.erfc(bound / math.sqrt(2)) / 2
