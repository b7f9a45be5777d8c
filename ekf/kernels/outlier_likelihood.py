"""Likelihood of the rows of an innovation, with or without outliers, compiled.

The rows of a scan are processed in order, each conditioned on all earlier rows: the Cholesky elimination of S = U'U
computes the conditional innovation e, and its pivot is the conditional variance v of e. The distribution of e is

* N(0, v) without outliers,
* a mixture of N(0, v) and, with probability `rate`, N(0, v + spread^2), or
* Student's t with `dof` degrees of freedom and scale sqrt(v).

A row that may be an outlier corrects with a weight w: the probability that it is not an outlier, or for Student's t
(dof + 1) / (dof + e^2 / v), at most 1. Its pivot is divided by w, which multiplies the gain by w. This keeps the mean
of the mixture of posteriors, as probabilistic data association does, but not the spread of their means (Bar-Shalom and
Tse, Automatica 11(5), 1975).

A diverged filter would classify all observations as outliers and never recover. Therefore, after a run of outliers of
different landmarks whose probability is below INCREDIBLE, rows correct with full weight until one of them fits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.jit import inner

GAUSSIAN, MIXTURE, STUDENT_T = 0, 1, 2
LEAST_WEIGHT = 1e-12
DOUBTED = 0.5  # a row with a smaller weight is more likely an outlier
INCREDIBLE = 1e-9  # probability of a run of outliers below which the filter is taken as diverged
HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Tails(NamedTuple):
    """Distribution of each row of an observation."""

    law: Int  # (2,) GAUSSIAN, MIXTURE or STUDENT_T
    rate: Float  # (2,) share of outliers of the mixture
    spread: Float  # (2,) standard deviation that outliers add [m or rad]
    dof: Float  # (2,) degrees of freedom of Student's t


class Run(NamedTuple):
    """Consecutive observations with a weight below DOUBTED."""

    length: int  # number of changes of landmark plus 1; 0 for an empty run
    slot: int  # newest landmark of the run; NONE for an empty run


class Rows(NamedTuple):
    """Results of every row of every observation; rows without information have variance 0 and likelihood 0."""

    innovation: Float  # (2M,) e, conditional on all earlier rows [m or rad]
    variance: Float  # (2M,) v, without outliers
    weight: Float  # (2M,) w
    log_likelihood: Float  # (2M,)


@inner
def weigh(e: float, v: float, row: int, tails: Tails) -> tuple[float, float]:
    """Return log-likelihood and weight of a conditional innovation e with variance v, for `row` 0 or 1."""
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


@inner
def factor_weighing(S: Float, y: Float, jacobian: Float, tails: Tails, is_lost: bool, rows: Rows) -> bool:
    """Factor S = U'U in place with pivots divided by weights, y <- U'^-1 y, and fill the `rows` of y.

    Uses the upper triangle of the first len(y) rows of S. If the filter is lost, all pivots keep full weight. Returns
    False if S is not positive definite.
    """
    count = len(y)
    for a in range(count):
        for b in range(a):
            y[a] -= S[b, a] * y[b]
        variance, e = S[a, a], y[a]
        if not (variance > 0.0 and math.isfinite(variance + e)):
            return False
        weight = 1.0
        if _is_informative(jacobian[a]):
            likelihood, weight = weigh(e, variance, a % 2, tails)
            rows.innovation[a], rows.variance[a] = e, variance
            rows.weight[a], rows.log_likelihood[a] = weight, likelihood
        root = math.sqrt(variance if is_lost else variance / weight)
        y[a] = e / root
        S[a, a] = root
        for c in range(a + 1, count):
            S[a, c] /= root
        for b in range(a + 1, count):
            for c in range(b, count):
                S[b, c] -= S[a, b] * S[a, c]
    return True


@inner
def rows_between(rows: Rows, start: int, end: int) -> Rows:
    """Return the rows of observations start..end, as views."""
    part = slice(2 * start, 2 * end)
    return Rows(rows.innovation[part], rows.variance[part], rows.weight[part], rows.log_likelihood[part])


@inner
def longest_run(tails: Tails) -> float:
    """Return the length of a run of outliers whose probability is INCREDIBLE."""
    longest = 1e9  # no limit without a mixture
    for row in range(len(tails.law)):
        if tails.law[row] == MIXTURE:
            longest = min(longest, math.log(INCREDIBLE) / math.log(tails.rate[row]))
    return longest


@inner
def continued(run: Run, slots: Int, rows: Rows, start: int, end: int) -> Run:
    """Return the run of doubted observations after the observations start..end."""
    for i in range(start, end):
        informative = rows.variance[2 * i] + rows.variance[2 * i + 1] > 0.0
        if informative and min(rows.weight[2 * i], rows.weight[2 * i + 1]) >= DOUBTED:
            run = Run(0, NONE)
        elif informative and slots[i] != run.slot:
            run = Run(run.length + 1, slots[i])
    return run


@inner
def _is_informative(h: Float) -> bool:
    """Return whether a row with this Jacobian (5,) has information."""
    return h[3] != 0.0 or h[4] != 0.0
