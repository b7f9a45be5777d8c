"""Tests for exhausted double precision, compiled: a difference that is only rounding.

A double has 16 digits. An update subtracts: rows of H P H' cancel where robot and landmark share most of their
variance, a pivot of S is a conditional variance given the rows above, and P - W'W is the covariance after the update.
Each must keep three digits. A singular covariance passes these tests: its zeros are not results of a subtraction.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.jit import kernel

LARGEST = 1e50  # limit of measurements; a filter that starts with it is still finite after every sum of squares
LEAST = 1e-13  # smallest difference, relative to its minuend
EXHAUSTED = math.inf  # NIS of an update that exhausts double precision
NO_MINIMUM = -math.inf  # NIS of an iterated update that finds no minimum


@kernel
def are_pivots_lost(U: Float, cov: Float, slots: Int, jacobian: Float) -> bool:
    """Return whether a pivot of S = U'U = H P H' + R is no more than the rounding of H P H'."""
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
    """Return whether P - W'W is only rounding for the robot's position, its heading or a landmark in `slots`.

    Slots of -1 are ignored. The two variances of a position are added: one of them may be exact from the beginning.
    """
    if _is_lost(cov, W, rows, 0, 2) or _is_lost(cov, W, rows, 2, 1):
        return True
    for slot in slots:  # noqa: SIM110 numba compiles no generator expressions
        if slot >= 0 and _is_lost(cov, W, rows, ROBOT + 2 * slot, 2):
            return True
    return False


@kernel
def _is_lost(cov: Float, W: Float, rows: int, first: int, count: int) -> bool:
    """Return whether the sum of `count` variances from entry `first` on is only rounding."""
    before, taken = 0.0, 0.0
    for j in range(first, first + count):
        before += cov[j, j]
        for k in range(rows):
            taken += W[k, j] * W[k, j]
    return taken > 0.0 and not before - taken > LEAST * before
