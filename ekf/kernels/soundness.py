"""Checks of increments, observations and their covariances, compiled: the rules of `slamgauge.validation`."""

from __future__ import annotations

import math

from slamgauge.arrays import Float
from slamgauge.formula_kernels import HAS_RANGE
from slamgauge.jit import inner, kernel
from slamgauge.validation import LARGEST

CORRELATION_ROUNDING = 1e-8  # tolerance of a correlation: ten times that of `slamgauge.validation`


@kernel
def are_sound(sensor: int, values: Float, covs: Float) -> bool:
    """Return whether observations (m, 2) and their covariances (m, 2, 2) are valid.

    Values are below `LARGEST`, ranges are not negative, and covariances are positive definite.
    """
    for i in range(len(values)):
        R = covs[i]
        if not (abs(values[i, 0]) < LARGEST and abs(values[i, 1]) < LARGEST):
            return False
        if HAS_RANGE[sensor] and values[i, 0] < 0.0:
            return False
        product = R[0, 0] * R[1, 1]
        if not (R[0, 0] > 0.0 and product - R[0, 1] * R[1, 0] > 0.0 and R[0, 0] + R[1, 1] < LARGEST * LARGEST):
            return False
        if not is_symmetric(R[0, 1], R[1, 0], product, max(R[0, 0], R[1, 1])):
            return False
    return True


@inner
def is_increment_sound(increment: Float, cov: Float) -> bool:
    """Return whether an increment (3,) and its covariance (3, 3) are valid: below `LARGEST`, and semi-definite."""
    for i in range(3):
        if not abs(increment[i]) < LARGEST:
            return False
        for j in range(3):
            if not abs(cov[i, j]) < LARGEST * LARGEST:
                return False
    return is_semidefinite(cov)


@inner
def is_semidefinite(Q: Float) -> bool:
    """Return whether Q (3, 3) is symmetric and positive semi-definite up to rounding; zero is valid.

    This is the rule of `slamgauge.validation` with a larger tolerance. Q is scaled to correlations, except for entries
    whose variance is not positive; its smallest eigenvalue must then be at least -CORRELATION_ROUNDING.
    """
    largest = 0.0
    for i in range(3):
        for j in range(3):
            largest = max(largest, abs(Q[i, j]))
    for i in range(3):
        if not Q[i, i] >= -1e-11 * largest:
            return False
        for j in range(i):
            if not is_symmetric(Q[i, j], Q[j, i], Q[i, i] * Q[j, j], largest):
                return False
    sx, sy, st = _unit(Q[0, 0]), _unit(Q[1, 1]), _unit(Q[2, 2])
    xy, xt, yt = 0.5 * (Q[0, 1] + Q[1, 0]), 0.5 * (Q[0, 2] + Q[2, 0]), 0.5 * (Q[1, 2] + Q[2, 1])
    xy, xt, yt = xy / (sx * sy), xt / (sx * st), yt / (sy * st)
    xx, yy, tt = (
        Q[0, 0] / (sx * sx) + CORRELATION_ROUNDING,
        Q[1, 1] / (sy * sy) + CORRELATION_ROUNDING,
        Q[2, 2] / (st * st) + CORRELATION_ROUNDING,
    )
    if not xx > 0.0:
        return False
    yy -= xy * xy / xx  # eliminate one variable after the other: all pivots must be positive
    yt -= xy * xt / xx
    tt -= xt * xt / xx
    return yy > 0.0 and tt - yt * yt / yy > 0.0


@inner
def _unit(variance: float) -> float:
    """Return the standard deviation, or 1 if the variance is not positive."""
    return math.sqrt(variance) if variance > 0.0 else 1.0


@inner
def is_symmetric(one: float, other: float, product: float, largest: float) -> bool:
    """Return whether two opposite entries of a covariance are equal up to rounding.

    `product` is the product of their variances, and `largest` the largest entry of the matrix.
    """
    return abs(one - other) <= CORRELATION_ROUNDING * math.sqrt(abs(product)) + 1e-14 * largest
