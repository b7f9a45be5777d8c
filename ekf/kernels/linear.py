"""Measurements and state entries that bring a Jacobian of their own, whatever entries of the state it touches.

The Jacobian is given on the `columns` that are not zero. Of `cov` only the upper triangle is kept, as in `kernels`.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.compiled import combine_rows, kernel, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.take_in import divide_by_factor


@kernel
def project_columns(cov: Float, size: int, columns: Int, jacobian: Float, W: Float) -> None:
    """W (rows, size) = H P."""
    W[:, :size] = 0.0
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


@kernel
def take_in_linear(
    cov: Float,
    size: int,
    columns: Int,
    jacobian: Float,
    innovation: Float,
    noise: Float,
    W: Float,
    S: Float,
    dx: Float,
) -> float:
    """P <- P - W'W and dx = K v for innovations v (r,) with covariance H P H' + noise (r, r).

    W (r, size) and S (r, r) are room to work in. Returns the NIS; when it is not finite, nothing has changed.
    """
    rows = len(innovation)
    project_columns(cov, size, columns, jacobian, W)
    for a in range(rows):
        for b in range(a, rows):
            S[a, b] = noise[a, b]
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
def append_linear(cov: Float, size: int, columns: Int, jacobian: Float, own: Float) -> None:
    """Append k state entries J x + noise, with the noise's covariance `own` (k, k)."""
    count = len(own)
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
