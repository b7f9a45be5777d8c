"""Compiled operations on 3 x 3 matrices; numpy's routines are slower and take seconds to compile."""

from __future__ import annotations

import math

import numpy as np
from numpy.linalg import LinAlgError

from slamgauge.arrays import Float
from slamgauge.jit import inner, kernel


@inner
def multiply(A: Float, x: Float, out: Float) -> None:
    """Compute `out` = A x for A (3, 3) and x (3,)."""
    for i in range(3):
        out[i] = A[i, 0] * x[0] + A[i, 1] * x[1] + A[i, 2] * x[2]


@inner
def copy(A: Float, out: Float) -> None:
    """Copy A to `out`; an assignment of arrays takes a second to compile."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, j]


@inner
def product(A: Float, B: Float, out: Float) -> None:
    """Compute `out` = A B; `out` must not be A or B."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@inner
def product_transposed(A: Float, B: Float, out: Float) -> None:
    """Compute `out` = A B'."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@inner
def add_product(A: Float, B: Float, out: Float) -> None:
    """Add A B to `out`, for B (3, width)."""
    for i in range(3):
        for j in range(B.shape[1]):
            out[i, j] += A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@inner
def symmetrise(A: Float) -> None:
    """Replace A by (A + A') / 2."""
    for i in range(3):
        for j in range(i):
            A[i, j] = A[j, i] = 0.5 * (A[i, j] + A[j, i])


@inner
def add_identity(A: Float) -> None:
    """Add the identity to A."""
    for i in range(3):
        A[i, i] += 1.0


@kernel
def invert(A: Float, inverse: Float) -> None:
    """Compute `inverse` = A^-1 by Gaussian elimination with partial pivoting; A is overwritten.

    Raises:
        numpy.linalg.LinAlgError: A is singular, or not finite.
    """
    for i in range(3):
        for j in range(3):
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(3):
        pivot = i
        for n in range(i + 1, 3):
            if abs(A[n, i]) > abs(A[pivot, i]):
                pivot = n
        if not 0.0 < abs(A[pivot, i]) < math.inf:
            raise LinAlgError("a singular matrix has no inverse")
        for j in range(3):
            A[i, j], A[pivot, j] = A[pivot, j], A[i, j]
            inverse[i, j], inverse[pivot, j] = inverse[pivot, j], inverse[i, j]
        for n in range(i + 1, 3):
            factor = A[n, i] / A[i, i]
            for j in range(3):
                A[n, j] -= factor * A[i, j]
                inverse[n, j] -= factor * inverse[i, j]
    for i in range(2, -1, -1):
        for j in range(3):
            for n in range(i + 1, 3):
                inverse[i, j] -= A[i, n] * inverse[n, j]
            inverse[i, j] /= A[i, i]


@kernel
def factorise(A: Float) -> None:
    """Replace the lower triangle of A by the Cholesky factor L, L L' = A.

    Raises:
        numpy.linalg.LinAlgError: A is not positive definite, or not finite.
    """
    for i in range(3):
        for j in range(i + 1):
            rest = A[i, j]
            for n in range(j):
                rest -= A[i, n] * A[j, n]
            if j < i:
                A[i, j] = rest / A[j, j]
            elif 0.0 < rest < math.inf:
                A[i, i] = math.sqrt(rest)
            else:
                raise LinAlgError("no factor: the matrix is not positive definite")


@inner
def invert_factor(L: Float, inverse: Float) -> None:
    """Compute `inverse` = L^-1 for lower triangular L (3, 3); entries above its diagonal are ignored."""
    for j in range(3):
        for i in range(3):
            rest = 1.0 if i == j else 0.0
            for n in range(j, i):
                rest -= L[i, n] * inverse[n, j]
            inverse[i, j] = rest / L[i, i] if i >= j else 0.0


@inner
def gram(rows: Float) -> Float:
    """Return the sum (width, width) of the outer products of the rows (n, width)."""
    return np.dot(rows.T, rows)
