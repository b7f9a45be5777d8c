"""Limits of double precision: an update whose result would only be rounding is refused, compiled.

A double has 16 digits; three must be left. Differences in S and in P are compared with their terms.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT, Belief, Pending, Workspace
from slamgauge.jit import inner

LEAST_SHARE = 1e-13  # smallest difference of two numbers, relative to the larger one, that is more than rounding
SAFE_SHARE = 1e-3  # share of the information that would exhaust double precision; below it, P needs no backup
EXHAUSTED = math.inf  # NIS of an update that exhausts double precision


@inner
def are_pivots_lost(U: Float, cov: Float, slots: Int, jacobian: Float) -> bool:
    """Return whether a pivot of S = U'U = H P H' + R is only rounding of H P H'."""
    for k in range(2 * len(slots)):
        if not U[k, k] * U[k, k] > LEAST_SHARE * _entered(cov, jacobian[k], ROBOT + 2 * slots[k // 2]):
            return True
    return False


@inner
def _entered(cov: Float, h: Float, landmark: int) -> float:
    """Return the sum of h^2 P over the five entries of a row of H: a fifth of an upper bound of h P h'."""
    entered = h[0] * h[0] * cov[0, 0] + h[1] * h[1] * cov[1, 1] + h[2] * h[2] * cov[2, 2]
    return entered + h[3] * h[3] * cov[landmark, landmark] + h[4] * h[4] * cov[landmark + 1, landmark + 1]


@inner
def are_variances_lost(cov: Float, slots: Int, pending: Pending, work: Workspace) -> bool:
    """Return whether P with its pending changes is only rounding, for the robot's position or heading or for `slots`.

    The two variances of a position are added, because one of them may be zero from the start.
    """
    for i in range(-2, len(slots)):
        first = ROBOT + 2 * slots[i] if i >= 0 else 2 * (i + 2)  # the position is at 0, the heading at 2
        before, taken = 0.0, 0.0
        for j in range(first, first + (1 if first == 2 else 2)):
            before += cov[j, j]
            for k in range(pending.rows):
                taken += work.W[k, j] * work.W[k, j]
            for k in range(pending.pairs):
                before += 2.0 * work.u[k, j] * work.a[k, j]
        if taken > 0.0 and not before - taken > LEAST_SHARE * before:
            return True
    return False


@inner
def backup(belief: Belief, count: int, block: int, work: Workspace) -> Float:
    """Return a copy of P if a block after the first might exhaust double precision, else an empty array.

    A scan reduces no variance to less than 1 / (1 + tr(R^-1 H P H')) of its value, no pivot of S is smaller than the
    same pivot of R, and (H P H')_aa is at most five times the sum of h^2 P. If these bounds are far from exhausting
    double precision, every block has an update.
    """
    information, h = 0.0, work.jacobian
    for i in range(count if count > block else 0):
        R, landmark = work.observation_cov[i], ROBOT + 2 * work.slots[i]
        determinant = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        least = determinant / (R[0, 0] + R[1, 1])  # at most the smallest eigenvalue
        information += R[0, 0] * R[1, 1] / determinant  # a pivot of R is at least this share of its variance
        for k in (2 * i, 2 * i + 1):
            information += 5.0 * _entered(belief.cov, h[k], landmark) / least
    needed = 0 if 0.0 <= information < SAFE_SHARE / LEAST_SHARE else belief.size
    return belief.cov[:needed, :needed].copy()


@inner
def restore(cov: Float, kept: Float) -> None:
    """Copy a backup (n, n) of P to its first rows and columns."""
    for i in range(len(kept)):
        for j in range(len(kept)):
            cov[i, j] = kept[i, j]
