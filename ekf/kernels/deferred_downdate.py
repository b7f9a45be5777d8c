"""Updates that wait: small changes of a large covariance, several scans' in one pass over it, compiled.

A scan changes P <- P - L'R: by L = R = W, and by L = [u; a], R = -[a; u] in the right-invariant filter. Where that is
few rows, the way through P costs more than the products. So they are taken at once out of what every step reads, the
robot's rows and each landmark's own block of four; the covariances of landmarks with each other wait, until the room is
full or somebody reads them. A scan makes up for what waits in its H P.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.blas import subtract_gram, subtract_product
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.jit import kernel

ENTRIES = 100  # of the state for each row: with fewer, P is in the caches and waiting costs more than it saves
PANEL = 128  # rows of P that are settled at a time where L and R differ


class Waiting(NamedTuple):
    """What waits: L and R, in which the robot's columns are zero, and those of landmarks that were mapped later."""

    rows: Float  # (1 or 2, room, capacity) L, and R where it differs
    used: Int  # (1,) rows of each that wait


def allocate_waiting(sides: int, room: int, capacity: int) -> Waiting:
    """Nothing that waits; room for `room` rows of L, and of R if there are two `sides`."""
    return Waiting(np.zeros((sides, room, capacity)), np.zeros(1, dtype=np.int64))


@kernel
def may_wait(waiting: Waiting, rows: int, size: int) -> bool:
    """Whether a scan of that many rows waits: few beside P, and two such scans have room, or they join others."""
    used, room = waiting.used[0], waiting.rows.shape[1]
    return (0 < used <= room - rows) or (ENTRIES * rows <= size and 2 * rows <= room)


@kernel
def postpone(cov: Float, size: int, waiting: Waiting, L: Float, R: Float) -> None:
    """P <- P - L'R, of which the landmarks' covariances with each other wait."""
    if waiting.used[0] + len(L) > waiting.rows.shape[1]:
        settle(cov, size, waiting)
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
    first, last = waiting.used[0], waiting.used[0] + len(L)
    waiting.rows[:, first:last] = 0.0
    waiting.rows[0, first:last, ROBOT:size] = L[:, ROBOT:size]
    waiting.rows[-1, first:last, ROBOT:size] = R[:, ROBOT:size]
    waiting.used[0] = last


@kernel
def subtract_waiting(waiting: Waiting, size: int, slots: Int, jacobian: Float, W: Float) -> None:
    """W[:2m, :size] <- W - H L'R, which makes H P of what `project_covariance` has left there."""
    count, height = waiting.used[0], 2 * len(slots)
    L, LH, own = waiting.rows[0], np.empty((count, height)), np.empty((height, 2))
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        own[k] = W[k, x : x + 2]
        for p in range(count):
            LH[p, k] = L[p, x] * jacobian[k, 3] + L[p, x + 1] * jacobian[k, 4]
    subtract_product(W, LH, waiting.rows[-1], count, height, size)
    for k in range(height):
        x = ROBOT + 2 * slots[k // 2]
        W[k, x : x + 2] = own[k]  # nothing of a landmark's own block waits


@kernel
def settle(cov: Float, size: int, waiting: Waiting) -> None:
    """P <- P - L'R for what waits; then nothing does."""
    count = waiting.used[0]
    if count == 0:
        return
    own, cross = np.empty(size), np.empty(size)
    for x in range(ROBOT, size, 2):
        own[x], cross[x], own[x + 1] = cov[x, x], cov[x, x + 1], cov[x + 1, x + 1]
    L, R = waiting.rows[0], waiting.rows[-1]
    if len(waiting.rows) == 1:
        subtract_gram(cov, L, count, size)
    else:
        for first in range(0, size, PANEL):
            height, width = min(PANEL, size - first), size - first
            subtract_product(cov[first:, first:], L[:, first:], R[:, first:], count, height, width)
    for x in range(ROBOT, size, 2):
        cov[x, x], cov[x, x + 1], cov[x + 1, x + 1] = own[x], cross[x], own[x + 1]
    waiting.used[0] = 0
