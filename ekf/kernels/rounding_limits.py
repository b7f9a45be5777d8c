"""Where double precision is exhausted, compiled: what is left of a difference is its rounding.

A double has 16 digits. An update subtracts: rows of H P H' cancel where robot and landmark share most of their
variance, a pivot of S is what is left of a variance once the rows above are known, and P - W'W is what is left of P. Of
each three digits must remain. A covariance that is singular is no such case: what it does not have is not subtracted.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.jit import kernel

LARGEST = 1e50  # of what is measured; a filter that starts with it is still finite after every sum of squares
LEAST = 1e-13  # share of what a difference was made of
EXHAUSTED = math.inf  # a NIS that says that double precision is exhausted,
NO_MINIMUM = -math.inf  # and one that says that the iterated filter has not come to a minimum


@kernel
def are_pivots_lost(U: Float, cov: Float, slots: Int, jacobian: Float) -> bool:
    """Whether a pivot of S = U'U = H P H' + R is no more than the rounding of H P H'."""
    for i in range(len(slots)):
        landmark = ROBOT + 2 * slots[i]
        for k in (2 * i, 2 * i + 1):
            h = jacobian[k]
            entered = h[0] * h[0] * cov[0, 0] + h[1] * h[1] * cov[1, 1] + h[2] * h[2] * cov[2, 2]
            entered += h[3] * h[3] * cov[landmark, landmark] + h[4] * h[4] * cov[landmark + 1, landmark + 1]
            if not U[k, k] * U[k, k] > LEAST * entered:
                return True
    return False


@kernel
def are_variances_lost(cov: Float, slots: Int, W: Float, rows: int) -> bool:
    """Whether P - W'W leaves but rounding of the robot's place, its heading or a landmark in `slots` (-1 is none).

    Both variances of a place are taken together: one alone may be rounding from the beginning, where it is exact.
    """
    if _is_lost(cov, W, rows, 0, 2) or _is_lost(cov, W, rows, 2, 1):
        return True
    for slot in slots:  # noqa: SIM110 numba compiles no generator expressions
        if slot >= 0 and _is_lost(cov, W, rows, ROBOT + 2 * slot, 2):
            return True
    return False


@kernel
def _is_lost(cov: Float, W: Float, rows: int, first: int, count: int) -> bool:
    """Whether that is so of the sum of `count` variances from entry `first` on."""
    before, taken = 0.0, 0.0
    for j in range(first, first + count):
        before += cov[j, j]
        for k in range(rows):
            taken += W[k, j] * W[k, j]
    return taken > 0.0 and not before - taken > LEAST * before
