"""Kernels of the compressed filter: updates of an area, and their effect on the rest of the map, compiled.

See `compressed_filter`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.blas import add_outer_pair, combine_rows, solve_factor, subtract_gram, subtract_product
from slamgauge.ekf.kernels.corrections import move_additively, move_invariantly, transform_covariance
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.joint_update import Gain, are_sound, whiten
from slamgauge.ekf.kernels.linearisation import Linearised, linearise_scan
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, are_variances_lost
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import kernel
from slamgauge.se2_kernels import mean_rotation


class Account(NamedTuple):
    """Effect of all updates since the robot entered its area, in terms of q rows of the covariance on entry."""

    T: Float  # (size, q)
    C: Float  # (q, q) upper triangle
    g: Float  # (q,)
    is_invariant: bool  # True for the right-invariant filter; q is then twice the area's size on entry


@kernel
def update_area(sensor: int, belief: Belief, count: int, work: Workspace, account: Account) -> tuple[float, int]:
    """Correct the area like `update_standard` or `update_right_invariant`, and update the account.

    A block of the workspace must be large enough for the whole scan.
    """
    scan, informative = linearise_scan(sensor, belief, count, work)
    if not are_sound(sensor, work.observation[:count], scan.noise_cov):
        return math.nan, informative
    gain, rows, size = whiten(belief, scan, 0, count, work), 2 * count, belief.size
    if not math.isfinite(gain.nis):
        return gain.nis, informative
    if are_variances_lost(belief.cov, scan.slots, gain.W, rows):
        return EXHAUSTED, informative
    dx = np.empty(size)
    combine_rows(gain.W, gain.y, dx, rows, size)
    subtract_gram(belief.cov, gain.W, rows, size)
    mirror_robot_block(belief.cov)
    move = _add_update(account, scan, gain, size)
    if account.is_invariant:
        u = move_invariantly(belief, dx)
        transform_covariance(belief, u, work.deferred)
        _add_retraction(account, belief, u, dx[2], move)
    else:
        move_additively(belief.state, size, dx)
    for j in range(len(move)):
        account.g[j] += move[j]
    return gain.nis, informative


@kernel
def _add_update(account: Account, scan: Linearised, gain: Gain, size: int) -> Float:
    """Add an update to T (size, q) and C; return its contribution N'y (q,) to g."""
    T, C = account.T, account.C
    width, rows = len(C), len(gain.y)
    N, move = np.empty((rows, width)), np.zeros(width)
    for k in range(rows):
        h, landmark = scan.jacobian[k], 3 + 2 * scan.slots[k // 2]
        for j in range(width):
            N[k, j] = h[0] * T[0, j] + h[1] * T[1, j] + h[2] * T[2, j]
            N[k, j] += h[3] * T[landmark, j] + h[4] * T[landmark + 1, j]
    solve_factor(gain.U, N, rows, width)
    subtract_gram(C, N, rows, width)
    subtract_product(T[:size, :width], gain.W[:, :size], N[:, :width])
    for k in range(rows):
        for j in range(width):
            move[j] += N[k, j] * gain.y[k]
    return move


@kernel
def _add_retraction(account: Account, belief: Belief, u: Float, turn: float, move: Float) -> None:
    """Add the retraction of the right-invariant filter, with u of T = I + u e_theta', to T, C and `move` (q,)."""
    T, cov, a = account.T, belief.cov, len(move) // 2
    v_cos, v_sin = mean_rotation(turn)
    t, c = T[2].copy(), np.empty(2 * a)
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
    add_outer_pair(account.C, c, t, 2 * a)
