"""Measurements and state entries whose Jacobian the caller gives, on any entries of the state.

The Jacobian is given on the `columns` that are not zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.blas import combine_rows, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.joint_update import divide_by_factor
from slamgauge.jit import kernel


@kernel
def project_columns(cov: Float, size: int, columns: Int, jacobian: Float, W: Float) -> None:
    """W[:rows, :size] = H P."""
    W[: len(jacobian), :size] = 0.0
    for c in range(len(columns)):
        column = columns[c]
        for r in range(len(jacobian)):
            h = jacobian[r, c]
            if h == 0.0:  # most are, where each row is of another landmark
                continue
            for j in range(column):
                W[r, j] += h * cov[j, column]
            for j in range(column, size):
                W[r, j] += h * cov[column, j]


class Room(NamedTuple):
    """Arrays to work in: W (r, size), S (r, r), and the correction dx (size,) that comes out; all may be larger."""

    W: Float
    S: Float
    dx: Float


@kernel
def take_in_linear(
    belief: Belief, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float, room: Room
) -> float:
    """P <- P - W'W and dx = K v for innovations v (r,) with covariance H P H' + noise_cov (r, r).

    Leaves dx in `room`. Returns the NIS; when it is not finite, nothing has changed.
    """
    cov, size = belief.cov, belief.size
    W, S, dx = room.W, room.S, room.dx
    rows = len(innovation)
    project_columns(cov, size, columns, jacobian, W)
    for a in range(rows):
        for b in range(a, rows):
            S[a, b] = noise_cov[a, b]
            for c in range(len(columns)):
                S[a, b] += W[a, columns[c]] * jacobian[b, c]
    y = innovation.copy()
    nis = divide_by_factor(S, W, y, rows, size)
    if math.isfinite(nis):
        combine_rows(W, y, dx, rows, size)
        subtract_gram(cov, W, rows, size)
        mirror_robot_block(cov)
    return nis


@kernel
def append_linear(belief: Belief, columns: Int, jacobian: Float, own: Float) -> None:
    """Append to P the rows of k new entries J x + noise, where `own` (k, k) is the covariance of that noise."""
    cov, size, count = belief.cov, belief.size, len(own)
    for r in range(count):
        for j in range(size):
            cov[j, size + r] = 0.0
        for c in range(len(columns)):
            column = columns[c]
            for j in range(column):
                cov[j, size + r] += jacobian[r, c] * cov[j, column]
            for j in range(column, size):
                cov[j, size + r] += jacobian[r, c] * cov[column, j]
    for r in range(count):
        for q in range(r, count):
            cov[size + r, size + q] = own[r, q]
            for c in range(len(columns)):
                cov[size + r, size + q] += jacobian[r, c] * cov[columns[c], size + q]
