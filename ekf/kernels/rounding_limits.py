"""Tests whether the differences in an update are only rounding errors of double precision, compiled.

A double has 16 digits. An update computes three kinds of differences: in H P H', where the variances that robot and
landmark share cancel; in the pivots of S, which are conditional variances given earlier rows; and in P - W'W. Each
result must keep three digits. A singular prior covariance passes these tests, because its zeros are not differences.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.jit import inner

LARGEST = 1e50  # limit of measured values; sums of their squares stay finite
LEAST = 1e-13  # smallest difference, relative to its minuend
EXHAUSTED = math.inf  # NIS of an update that exhausts double precision
NO_MINIMUM = -math.inf  # NIS of an iterated update that finds no minimum


@inner
def are_pivots_lost(U: Float, cov: Float, slots: Int, jacobian: Float) -> bool:
    """Return whether a pivot of S = U'U = H P H' + R is only rounding of H P H'."""
    for i in range(len(slots)):
        landmark = ROBOT + 2 * slots[i]
        for k in (2 * i, 2 * i + 1):
            h = jacobian[k]
            entered = h[0] * h[0] * cov[0, 0] + h[1] * h[1] * cov[1, 1] + h[2] * h[2] * cov[2, 2]
            entered += h[3] * h[3] * cov[landmark, landmark] + h[4] * h[4] * cov[landmark + 1, landmark + 1]
            if not U[k, k] * U[k, k] > LEAST * entered:
                return True
    return False


@inner
def are_variances_lost(cov: Float, slots: Int, W: Float, rows: int) -> bool:
    """Return whether P - W'W is only rounding for the robot's position, its heading or a landmark in `slots`.

    Slots of -1 are ignored. The two variances of a position are added, because one of them may be zero from the start.
    """
    if _is_lost(cov, W, rows, 0, 2) or _is_lost(cov, W, rows, 2, 1):
        return True
    for slot in slots:  # noqa: SIM110 numba compiles no generator expressions
        if slot >= 0 and _is_lost(cov, W, rows, ROBOT + 2 * slot, 2):
            return True
    return False


@inner
def _is_lost(cov: Float, W: Float, rows: int, first: int, count: int) -> bool:
    """Return whether the sum of `count` variances from entry `first` on is only rounding."""
    before, taken = 0.0, 0.0
    for j in range(first, first + count):
        before += cov[j, j]
        for k in range(rows):
            taken += W[k, j] * W[k, j]
    return taken > 0.0 and not before - taken > LEAST * before
