"""Updates and augmentations that may depend on any entries of the state, compiled.

The caller passes the Jacobians: `jacobian` (r, c) contains the derivatives by the state entries `columns` (c,).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.blas import combine_rows, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.update import whiten
from slamgauge.jit import inner, kernel


@inner
def project_columns(cov: Float, size: int, columns: Int, jacobian: Float, W: Float) -> None:
    """Compute W[:rows, :size] = H P."""
    W[: len(jacobian), :size] = 0.0
    for c in range(len(columns)):
        column = columns[c]
        for r in range(len(jacobian)):
            h = jacobian[r, c]
            if h == 0.0:  # true for most entries if each row is an observation of another landmark
                continue
            for j in range(column):
                W[r, j] += h * cov[j, column]
            for j in range(column, size):
                W[r, j] += h * cov[column, j]


class LinearUpdate(NamedTuple):
    """Result of `linear_update`."""

    dx: Float  # (size,) correction of the state; undefined if no update exists
    nis: float  # not finite if no update exists


@kernel
def linear_update(belief: Belief, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float) -> LinearUpdate:
    """P <- P - W'W, and return dx = K v, for innovations v (r,) with covariance H P H' + noise_cov (r, r).

    The state is not changed. If the NIS is not finite, P is unchanged too.
    """
    cov, size, rows = belief.cov, belief.size, len(innovation)
    W, S, dx = np.empty((rows, size)), np.empty((rows, rows)), np.empty(size)
    project_columns(cov, size, columns, jacobian, W)
    for a in range(rows):
        for b in range(a, rows):
            S[a, b] = noise_cov[a, b]
            for c in range(len(columns)):
                S[a, b] += W[a, columns[c]] * jacobian[b, c]
    y = innovation.copy()
    nis = whiten(S, W, y, rows, size)
    if math.isfinite(nis):
        combine_rows(W, y, dx, rows, size)
        subtract_gram(cov, W, rows, size)
        mirror_robot_block(cov)
    return LinearUpdate(dx, nis)


@kernel
def append_linear(belief: Belief, columns: Int, jacobian: Float, own: Float) -> None:
    """Append to P the columns of k new entries J x + noise; `own` (k, k) is the covariance of this noise."""
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
