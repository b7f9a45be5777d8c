"""Deferred downdates: small changes of a large covariance, those of several scans applied in one pass, compiled.

A scan changes P <- P - L'R: L = R = W in most filters; the right-invariant filter adds a change with L = [u; a],
R = -[a; u]. Where L has few rows, reading and writing P costs more than the products. The robot's rows of P and the
2 x 2 block of each landmark are therefore changed at once, because every step reads them. The covariances between
landmarks are changed later: when the deferred rows fill their array, or when these covariances are read. The H P of a
scan takes the deferred rows into account.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.blas import subtract_gram, subtract_product
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.jit import kernel

ENTRIES = 100  # state entries per row of L; with fewer, P fits into the caches and deferring costs more than it saves
PANEL = 128  # rows of P that are changed at a time where L and R differ


class Deferred(NamedTuple):
    """Rows of L and R that are not applied yet.

    The columns of the robot are zero, and so are those of landmarks that were mapped after the row was deferred.
    """

    rows: Float  # (1 or 2, room, capacity) L, and R where it differs
    used: Int  # (1,) number of deferred rows


def allocate_deferred(sides: int, room: int, capacity: int) -> Deferred:
    """Allocate `room` rows of L, and of R if there are two `sides`; nothing is deferred."""
    return Deferred(np.zeros((sides, room, capacity)), np.zeros(1, dtype=np.int64))


@kernel
def may_defer(deferred: Deferred, rows: int, size: int) -> bool:
    """Return whether a scan with `rows` rows is deferred.

    It is if it joins deferred rows, or if it is small compared with P and there is room for two such scans.
    """
    used, room = deferred.used[0], deferred.rows.shape[1]
    return (0 < used <= room - rows) or (ENTRIES * rows <= size and 2 * rows <= room)


@kernel
def defer(cov: Float, size: int, deferred: Deferred, L: Float, R: Float) -> None:
    """P <- P - L'R, where the covariances between landmarks are deferred."""
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
    deferred.rows[0, first:last, ROBOT:size] = L[:, ROBOT:size]
    deferred.rows[-1, first:last, ROBOT:size] = R[:, ROBOT:size]
    deferred.used[0] = last


@kernel
def subtract_deferred(deferred: Deferred, size: int, slots: Int, jacobian: Float, W: Float) -> None:
    """W[:2m, :size] <- W - H L'R, which corrects the H P of `project_covariance` for the deferred rows."""
    count, height = deferred.used[0], 2 * len(slots)
    L, LH, own = deferred.rows[0], np.empty((count, height)), np.empty((height, 2))
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        own[k] = W[k, x : x + 2]
        for p in range(count):
            LH[p, k] = L[p, x] * jacobian[k, 3] + L[p, x + 1] * jacobian[k, 4]
    subtract_product(W, LH, deferred.rows[-1], count, height, size)
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        W[k, x : x + 2] = own[k]  # a landmark's own block is never deferred


@kernel
def apply_deferred(cov: Float, size: int, deferred: Deferred) -> None:
    """P <- P - L'R for the deferred rows; nothing is deferred afterwards."""
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
            height, width = min(PANEL, size - first), size - first
            subtract_product(cov[first:, first:], L[:, first:], R[:, first:], count, height, width)
    for x in range(ROBOT, size, 2):
        cov[x, x], cov[x, x + 1], cov[x + 1, x + 1] = own[x], cross[x], own[x + 1]
    deferred.used[0] = 0
