"""Deferred downdates: the small changes of several scans are applied to a large covariance in one pass, compiled.

A scan changes P <- P - L'R: L = R = W in most filters; the right-invariant filter adds a change with L = [u; a],
R = -[a; u]. If L has few rows, reading and writing P takes longer than the products. Every step reads the robot's rows
of P and the 2 x 2 block of each landmark, so these are changed immediately. The covariances between landmarks are
changed later: when the array of deferred rows is full, or when these covariances are read. `subtract_deferred` corrects
the product H P of a scan for the deferred rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.blas import subtract_gram, subtract_product
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.jit import inner, kernel

ENTRIES = 100  # state entries per row of L; with fewer, P fits into the processor's caches and deferring is slower
PANEL = 128  # rows of P that are changed in one product if L and R differ


class Deferred(NamedTuple):
    """Rows of L and R that are not applied yet.

    A row is zero in the columns of the robot and of landmarks that were mapped after the row was deferred.
    """

    rows: Float  # (1 or 2, room, capacity) L, and R if it differs
    used: Int  # (1,) number of deferred rows


def allocate_deferred(sides: int, room: int, capacity: int) -> Deferred:
    """Allocate `room` rows of L, and the same of R if `sides` is 2."""
    return Deferred(np.zeros((sides, room, capacity)), np.zeros(1, dtype=np.int64))


@inner
def may_defer(deferred: Deferred, rows: int, size: int) -> bool:
    """Return whether a scan with `rows` rows is deferred.

    It is deferred if other rows are deferred and it fits after them, or if it is small compared with P and two such
    scans fit.
    """
    used, room = deferred.used[0], deferred.rows.shape[1]
    return (0 < used <= room - rows) or (ENTRIES * rows <= size and 2 * rows <= room)


@inner
def defer(cov: Float, size: int, deferred: Deferred, L: Float, R: Float) -> None:
    """P <- P - L'R; the covariances between landmarks are deferred."""
    if deferred.used[0] + len(L) > deferred.rows.shape[1]:
        apply_deferred(cov, size, deferred)
    own, cross = np.zeros(size), np.zeros(size)
    for k in range(len(L)):
        for i in range(ROBOT):
            for j in range(i, size):
                cov[i, j] -= L[k, i] * R[k, j]
        for j in range(ROBOT, size):
            own[j] += L[k, j] * R[k, j]
        for j in range(ROBOT, size - 1):
            cross[j] += L[k, j] * R[k, j + 1]
    for x in range(ROBOT, size, 2):
        cov[x, x] -= own[x]
        cov[x, x + 1] -= cross[x]
        cov[x + 1, x + 1] -= own[x + 1]
    mirror_robot_block(cov)
    first, last = deferred.used[0], deferred.used[0] + len(L)
    deferred.rows[:, first:last] = 0.0
    for k in range(len(L)):
        for j in range(ROBOT, size):
            deferred.rows[0, first + k, j] = L[k, j]
            deferred.rows[-1, first + k, j] = R[k, j]
    deferred.used[0] = last


@inner
def subtract_deferred(deferred: Deferred, size: int, slots: Int, jacobian: Float, W: Float) -> None:
    """W[:2m, :size] <- W - H L'R: correct the H P of `project_covariance` for the deferred rows."""
    count, height = deferred.used[0], 2 * len(slots)
    L, LH, own = deferred.rows[0], np.empty((count, height)), np.empty((height, 2))
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        own[k, 0], own[k, 1] = W[k, x], W[k, x + 1]
        for p in range(count):
            LH[p, k] = L[p, x] * jacobian[k, 3] + L[p, x + 1] * jacobian[k, 4]
    subtract_product(W[:height, :size], LH[:, :height], deferred.rows[-1][:count, :size])
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        W[k, x], W[k, x + 1] = own[k, 0], own[k, 1]  # the 2 x 2 block of a landmark is never deferred


@kernel
def apply_deferred(cov: Float, size: int, deferred: Deferred) -> None:
    """P <- P - L'R for all deferred rows; none is deferred afterwards."""
    count = deferred.used[0]
    if count == 0:
        return
    own, cross = np.empty(size), np.empty(size)
    for x in range(ROBOT, size, 2):
        own[x], cross[x], own[x + 1] = cov[x, x], cov[x, x + 1], cov[x + 1, x + 1]
    L, R = deferred.rows[0], deferred.rows[-1]
    if len(deferred.rows) == 1:
        subtract_gram(cov, L, count, size)
    else:
        for first in range(0, size, PANEL):
            last = min(first + PANEL, size)
            subtract_product(cov[first:last, first:size], L[:count, first:last], R[:count, first:size])
    for x in range(ROBOT, size, 2):
        cov[x, x], cov[x, x + 1], cov[x + 1, x + 1] = own[x], cross[x], own[x + 1]
    deferred.used[0] = 0
