"""Rows of an innovation by their likelihood, with or without outliers, compiled.

The rows of a scan are taken one after the other, each conditioned on those before it: Cholesky's elimination of
S = U'U does that, and its pivot is the conditional variance v of the conditional innovation e. With outliers e is

* of a mixture: N(0, v) but for a share `rate` of N(0, v + spread^2), or
* of Student's t with `dof` degrees of freedom and scale sqrt(v).

A row that may be an outlier corrects by its weight w alone, the probability that it is none (for Student's t
(dof + 1) / (dof + e^2 / v), at most 1): its pivot is divided by w, and the gain multiplied by it. That keeps the mean
of the mixture of posteriors, as probabilistic data association does, and leaves out the spread of its means (Bar-Shalom
and Tse, Automatica 11(5), 1975).

A filter that is lost takes all that it sees for outliers, and would never come back. A run of outliers of landmark
after landmark that is less likely than INCREDIBLE is therefore none: rows correct by their full weight until one fits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from slamgauge.arrays import Float, Int
from slamgauge.jit import inner, kernel

GAUSSIAN, MIXTURE, STUDENT_T = 0, 1, 2
LEAST_WEIGHT = 1e-12
DOUBTED = 0.5  # a row of less weight is rather an outlier than none
INCREDIBLE = 1e-9
HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Tails(NamedTuple):
    """How the rows of an observation are distributed, each by its own law."""

    law: Int  # (2,) GAUSSIAN, MIXTURE or STUDENT_T
    rate: Float  # (2,) share of outliers of the mixture
    spread: Float  # (2,) what their standard deviation has more [m or rad]
    dof: Float  # (2,) degrees of freedom of Student's t


class Run(NamedTuple):
    """Landmarks that came one after the other and were all doubted."""

    length: int  # how many times the landmark changed, and 1
    slot: int  # the newest; -1 after one that was not doubted


class Rows(NamedTuple):
    """What a run leaves of every row of every observation; rows that say nothing have variance 0 and likelihood 0."""

    innovation: Float  # (2M,) e, conditional on all rows before [m or rad]
    variance: Float  # (2M,) v, without outliers
    weight: Float  # (2M,) w
    log_likelihood: Float  # (2M,)


@kernel
def weigh(e: float, v: float, row: int, tails: Tails) -> tuple[float, float]:
    """Log-likelihood and weight of a conditional innovation e of variance v in `row` (0 or 1) of an observation."""
    law, normal = tails.law[row], -0.5 * (math.log(v) + e * e / v) - HALF_LOG_TWO_PI
    if law == MIXTURE:
        wide = v + tails.spread[row] ** 2
        inlier = math.log1p(-tails.rate[row]) + normal
        outlier = math.log(tails.rate[row]) - 0.5 * (math.log(wide) + e * e / wide) - HALF_LOG_TWO_PI
        larger = max(inlier, outlier)
        total = larger + math.log(math.exp(inlier - larger) + math.exp(outlier - larger))
        return total, max(math.exp(inlier - total), LEAST_WEIGHT)
    if law == STUDENT_T:
        dof = tails.dof[row]
        constant = math.lgamma(0.5 * (dof + 1.0)) - math.lgamma(0.5 * dof) - 0.5 * math.log(dof * math.pi * v)
        density = constant - 0.5 * (dof + 1.0) * math.log1p(e * e / (v * dof))
        return density, min(1.0, (dof + 1.0) / (dof + e * e / v))
    return normal, 1.0


@kernel
def factor_weighing(S: Float, y: Float, jacobian: Float, tails: Tails, is_lost: bool, rows: Rows, first: int) -> bool:
    """S = U'U in place with pivots divided by weights, and y <- U'^-1 y; fills `rows` from row `first` on.

    Upper triangle only, of as many rows as y has. A filter that is lost corrects by full weights. False if S is not
    positive definite.
    """
    count = len(y)
    for a in range(count):
        for b in range(a):
            y[a] -= S[b, a] * y[b]
        variance, e = S[a, a], y[a]
        if not (variance > 0.0 and math.isfinite(variance + e)):
            return False
        weight = 1.0
        if _tells(jacobian[a]):
            likelihood, weight = weigh(e, variance, a % 2, tails)
            k = first + a
            rows.innovation[k], rows.variance[k] = e, variance
            rows.weight[k], rows.log_likelihood[k] = weight, likelihood
        root = math.sqrt(variance if is_lost else variance / weight)
        y[a] = e / root
        S[a, a] = root
        for c in range(a + 1, count):
            S[a, c] /= root
        for b in range(a + 1, count):
            for c in range(b, count):
                S[b, c] -= S[a, b] * S[a, c]
    return True


@kernel
def longest_run(tails: Tails) -> float:
    """Landmarks in a row that may all be outliers."""
    longest = 1e9  # without a mixture: any number
    for row in range(len(tails.law)):
        if tails.law[row] == MIXTURE:
            longest = min(longest, math.log(INCREDIBLE) / math.log(tails.rate[row]))
    return longest


@kernel
def continued(run: Run, slots: Int, rows: Rows, start: int, end: int) -> Run:
    """The run after the observations start..end."""
    for i in range(start, end):
        told = rows.variance[2 * i] + rows.variance[2 * i + 1] > 0.0
        if told and min(rows.weight[2 * i], rows.weight[2 * i + 1]) >= DOUBTED:
            run = Run(0, -1)
        elif told and slots[i] != run.slot:
            run = Run(run.length + 1, slots[i])
    return run


@inner
def _tells(h: Float) -> bool:
    """Whether a row with this Jacobian (5,) carries information."""
    return h[3] != 0.0 or h[4] != 0.0
