"""Kernels of the compressed filter: the effect of an area's updates on the rest of the map; see `compressed_filter`."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.blas import add_outer_pair, solve_factor, subtract_gram, subtract_product
from slamgauge.ekf.kernels.workspace import CORRECTION, MOVE, Workspace
from slamgauge.jit import kernel
from slamgauge.se2_kernels import mean_rotation


@kernel
def account_for_update(count: int, size: int, work: Workspace, T: Float, N: Float, C: Float, move: Float) -> None:
    """Carry the update that `work` describes into the account, T (size, q) and C (q, q), and add N'y to `move` (q,).

    N is room.
    """
    width = C.shape[0]
    for i in range(count):
        landmark = 3 + 2 * work.slots[i]
        for k in (2 * i, 2 * i + 1):
            h = work.jacobian[k]
            for j in range(width):
                N[k, j] = h[0] * T[0, j] + h[1] * T[1, j] + h[2] * T[2, j]
                N[k, j] += h[3] * T[landmark, j] + h[4] * T[landmark + 1, j]
    rows = 2 * count
    solve_factor(work.S, N, rows, width)
    subtract_gram(C, N, rows, width)
    subtract_product(T, work.W, N, rows, size, width)
    for k in range(rows):
        for j in range(width):
            move[j] += N[k, j] * work.innovation[k]


@kernel
def account_for_turn(belief: Belief, work: Workspace, T: Float, C: Float, move: Float) -> None:
    """Carry the retraction that `update_right_invariant` has just made into T (size, 2a), C (2a, 2a), `move` (2a,)."""
    cov, a = belief.cov, len(move) // 2
    v_cos, v_sin = mean_rotation(work.scratch[CORRECTION, 2])
    u, t, c = work.scratch[MOVE], T[2].copy(), np.empty(2 * a)
    for j in range(a):
        x, y = move[j], move[a + j]
        move[j], move[a + j] = v_cos * x - v_sin * y, v_sin * x + v_cos * y
        c[j], c[a + j] = -move[a + j], move[j]
    for i in range(belief.size):
        heading = cov[min(i, 2), max(i, 2)]
        for j in range(2 * a):
            T[i, j] += u[i] * t[j] + heading * c[j]
    for j in range(2 * a):
        t[j] += 0.5 * cov[2, 2] * c[j]
    add_outer_pair(C, c, t, 2 * a)
