"""Elimination of the poses of a linearised graph, compiled. It leaves a linear system of the landmarks.

Given the landmarks u the poses are a Markov chain. The mean of pose k, given the measurements before its scan, is an
affine map M_k (1, u), and its covariance P_k. A scan depends on three numbers of its pose: with Hx = Q R it is reduced
to three rows R dx + X (1, u), X = Q' [r, Hm], of unit noise; the rest of the information is Hm' Hm - X' X. With
S = I + R P R' = L L' and T = L^-1 R,

    B = T M + L^-1 X,   information += B' B,   M <- M - P T' B,   P <- P - P T' T P,   M <- F M + c,   P <- F P F' + W.

No pose covariance is inverted, so motions of zero variance and a fixed start are exact. P and T of all poses are stored
for the way back: with the adjoints a_k = F' a_{k+1} and b_k = a_k + T' (B - T P a_k) the smoothed mean is M - P b_k.
This is a modified Bryson-Frazier smoother, which inverts no covariance either.

Source: Bierman, "Factorization methods for discrete sequential estimation", 1977, chapter X.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.linalg import LinAlgError

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans, Triple
from slamgauge.jit import inner, kernel

DEPENDENT = 1e-24  # a squared column of Hx whose remaining share is smaller is a combination of the columns before it
INEXACT = 1e-3  # smaller entries of I - Q Q' are computed without a difference


class Chain(NamedTuple):
    """Matrices of the eliminated poses, see the heading."""

    P: Float  # (N+1, 3, 3)
    T: Float  # (N+1, 3, 3), zero without a scan


class Frontier(NamedTuple):
    """The newest eliminated pose, and the information about the landmarks; column 0 is the constant."""

    M: Float  # (3, n+1) map of the newest pose, after its scan
    P: Float  # (3, 3) its covariance
    information: Float  # (n+1, n+1) lower triangle; only scans add to it, the caller adds B' B


def empty_chain(poses: int) -> Chain:
    """Return a chain of `poses` poses."""
    return Chain(*np.zeros((2, poses, 3, 3)))


def empty_frontier(unknowns: int) -> Frontier:
    """Return the front before the first pose."""
    size = unknowns + 1
    return Frontier(np.zeros((3, size)), np.zeros((3, 3)), np.zeros((size, size)))


@kernel
def eliminate_poses(
    scans: Scans,
    model: LinearModel,
    damping: Float,
    chain: Chain,
    front: Frontier,
    steps: tuple[int, int],
    maps: Float,
    rows: Float,
) -> None:
    """Eliminate the poses steps[0]..steps[1]-1 of a model, and advance the front.

    Args:
        scans: observations by pose.
        model: linearised at all these poses.
        damping: (3,) information added to each pose with a scan [1/m^2, 1/m^2, 1/rad^2].
        chain: gets P and T of these poses.
        front: on the pose before.
        steps: first pose, and the one after the last.
        maps: (n, 3, w) gets the first w columns of M before each scan.
        rows: (n, 3, w) gets B of each scan, zero without one.

    Raises:
        numpy.linalg.LinAlgError: a matrix is not finite, for instance because of a landmark at the position of a pose.
    """
    begin, width = steps[0], maps.shape[2]
    longest = 0
    for k in range(begin, steps[1]):
        longest = max(longest, scans.first[k + 1] - scans.first[k])
    dim = model.r.shape[1]
    columns, X, R = np.zeros((3, 3 + dim * longest)), np.zeros((3, 1 + 2 * longest)), np.zeros((3, 3))
    for k in range(begin, steps[1]):
        predict(model, front, width, k)
        B = rows[k - begin]
        for i in range(3):
            for j in range(3):
                chain.P[k, i, j] = front.P[i, j]
                chain.T[k, i, j] = 0.0
            for j in range(width):
                maps[k - begin, i, j] = front.M[i, j]
                B[i, j] = 0.0
        if reduce_scan(scans, model, damping, k, columns, R, X):
            add_scan(scans, model, k, columns, X, front.information, B)
            whiten(R, front, chain.T[k], B, width)
            correct(front, chain.T[k], B, width)


@inner
def predict(model: LinearModel, front: Frontier, width: int, k: int) -> None:
    """Predict pose k: M <- F M + c, P <- F P F' + W."""
    M, P, fx, fy = front.M, front.P, model.lever[k, 0], model.lever[k, 1]
    for j in range(width):
        M[0, j] += fx * M[2, j]
        M[1, j] += fy * M[2, j]
    for j in range(3):
        M[j, 0] += model.c[k, j]
        P[0, j] += fx * P[2, j]
        P[1, j] += fy * P[2, j]
    for i in range(3):
        P[i, 0] += fx * P[i, 2]
        P[i, 1] += fy * P[i, 2]
    for i in range(3):
        for j in range(i + 1):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i] + model.W[k, i, j] + model.W[k, j, i])


@inner
def reduce_scan(scans: Scans, model: LinearModel, damping: Float, k: int, columns: Float, R: Float, X: Float) -> bool:
    """Compute R (3, 3) and X (3, 1 + 2 m) of a scan with m rows; return whether it has an observation.

    Hx = Q R by Gram-Schmidt, each column twice for accuracy; a dependent column becomes zero. Damping adds three rows.
    """
    dim, used, is_empty = model.r.shape[1], 3, True
    for j in range(3):
        for i in range(3):
            columns[j, i] = math.sqrt(damping[j]) if i == j else 0.0
    for row in range(scans.first[k], scans.first[k + 1]):
        if scans.slot[row] >= 0:
            is_empty = False
        for i in range(dim):
            for j in range(3):
                columns[j, used] = model.Hx[row, i, j]
            used += 1
    if is_empty:
        return False
    for j in range(3):
        whole = squared_length(columns[j], used)
        for i in range(3):
            R[i, j] = 0.0
        for _ in range(2):
            for i in range(j):
                along = 0.0
                for n in range(used):
                    along += columns[i, n] * columns[j, n]
                R[i, j] += along
                for n in range(used):
                    columns[j, n] -= along * columns[i, n]
        left = squared_length(columns[j], used)
        R[j, j] = math.sqrt(left) if not left <= DEPENDENT * whole else 0.0
        for n in range(used):
            columns[j, n] = columns[j, n] / R[j, j] if R[j, j] != 0.0 else 0.0
    for j in range(3):
        X[j, 0], used = 0.0, 3
        for row in range(scans.first[k], scans.first[k + 1]):
            column = 1 + 2 * (row - scans.first[k])
            X[j, column] = X[j, column + 1] = 0.0
            for i in range(dim):
                q = columns[j, used]
                X[j, 0] += q * model.r[row, i]
                X[j, column] += q * model.Hm[row, i, 0]
                X[j, column + 1] += q * model.Hm[row, i, 1]
                used += 1
    return True


@inner
def squared_length(column: Float, used: int) -> float:
    """Return the sum of the first squared entries."""
    total = 0.0
    for n in range(used):
        total += column[n] * column[n]
    return total


@inner
def add_scan(scans: Scans, model: LinearModel, k: int, columns: Float, X: Float, information: Float, B: Float) -> None:
    """Add [r, Hm]' [r, Hm] - X' X of a scan to the information, and write X to the columns of its landmarks in B.

    Args:
        scans: observations by pose.
        model: linearised at pose k.
        k: pose of the scan.
        columns: Q of the scan, transposed.
        X: of the scan.
        information: of the landmarks.
        B: (3, n) zeros.
    """
    begin, end, dim = scans.first[k], scans.first[k + 1], model.r.shape[1]
    for row in range(begin, end):
        at = 1 + 2 * scans.slot[row]
        if at < 0:
            continue
        column, q = 1 + 2 * (row - begin), 3 + dim * (row - begin)
        outside = outside_of(columns, q, dim, 3 + dim * (end - begin))
        for i in range(dim):
            x, y, rest = model.Hm[row, i, 0], model.Hm[row, i, 1], model.r[row, i]
            for j in range(3):
                rest -= columns[j, q + i] * X[j, 0]
            information[at, 0] += x * rest
            information[at + 1, 0] += y * rest
            for n in range(dim):
                share = outside[i + n]
                information[at, at] += x * share * model.Hm[row, n, 0]
                information[at + 1, at] += y * share * model.Hm[row, n, 0]
                information[at + 1, at + 1] += y * share * model.Hm[row, n, 1]
        for j in range(3):
            B[j, at] += X[j, column]
            B[j, at + 1] += X[j, column + 1]
        for other in range(begin, end):
            to, o = 1 + 2 * scans.slot[other], 1 + 2 * (other - begin)
            if to < 0 or to > at or other == row:
                continue
            for i in range(2):
                for n in range(2):
                    information[at + i, to + n] -= (
                        X[0, column + i] * X[0, o + n] + X[1, column + i] * X[1, o + n] + X[2, column + i] * X[2, o + n]
                    )
    for j in range(3):
        B[j, 0] = X[j, 0]


@inner
def outside_of(columns: Float, q: int, dim: int, used: int) -> Triple:
    """Return entries 00, 01 and 11 of I - Q_i Q_i', for the rows q..q+dim-1 of Q; for one row, only 00 has a meaning.

    I - Q Q' is a projection. If these rows determine the pose, the difference loses its digits. It equals its square
    plus Q_i S Q_i', where S is the sum of Q_j' Q_j over the other rows: this has no small difference.
    """
    last = q + dim - 1
    a, b = (columns[0, q], columns[1, q], columns[2, q]), (columns[0, last], columns[1, last], columns[2, last])
    p00, p11, p01 = 1.0 - dot(a, a), 1.0 - dot(b, b), -dot(a, b)
    if dim == 1:
        p01, p11 = 0.0, 1.0
    if min(p00, p11) - abs(p01) > INEXACT:
        return p00, p01, p11
    k00, k01, k11 = p00 * p00 + p01 * p01, p01 * (p00 + p11), p01 * p01 + p11 * p11
    for n in range(used):
        if n < q or n > last:
            other = columns[0, n], columns[1, n], columns[2, n]
            along_a, along_b = dot(a, other), dot(b, other)
            k00 += along_a * along_a
            k01 += along_a * along_b
            k11 += along_b * along_b
    return k00, k01, k11


@inner
def dot(a: Triple, b: Triple) -> float:
    """Return a' b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def whiten(R: Float, front: Frontier, T: Float, B: Float, width: int) -> None:
    """Compute T = L^-1 R and B <- T M + L^-1 B, with S = I + R P R' = L L'."""
    L, P, M = np.zeros((3, 3)), front.P, front.M
    for i in range(3):
        for j in range(i + 1):
            S = 1.0 if i == j else 0.0
            for m in range(3):
                for n in range(3):
                    S += R[i, m] * P[m, n] * R[j, n]
            for n in range(j):
                S -= L[i, n] * L[j, n]
            if j < i:
                L[i, j] = S / L[j, j]
            elif 0.0 < S < math.inf:
                L[i, i] = math.sqrt(S)
            else:
                raise LinAlgError("a scan has no finite covariance")
    for i in range(3):
        for j in range(3):
            T[i, j] = R[i, j]
            for n in range(i):
                T[i, j] -= L[i, n] * T[n, j]
            T[i, j] /= L[i, i]
        for j in range(width):
            B[i, j] += R[i, 0] * M[0, j] + R[i, 1] * M[1, j] + R[i, 2] * M[2, j]
        for n in range(i):
            for j in range(width):
                B[i, j] -= L[i, n] * B[n, j]
        for j in range(width):
            B[i, j] /= L[i, i]


@inner
def correct(front: Frontier, T: Float, B: Float, width: int) -> None:
    """Correct M and P of the newest pose: M <- M - P T' B, P <- P - P T' T P."""
    M, P, V = front.M, front.P, np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            V[i, j] = P[i, 0] * T[j, 0] + P[i, 1] * T[j, 1] + P[i, 2] * T[j, 2]
    for i in range(3):
        for j in range(3):
            P[i, j] -= V[i, 0] * V[j, 0] + V[i, 1] * V[j, 1] + V[i, 2] * V[j, 2]
        for j in range(width):
            M[i, j] -= V[i, 0] * B[0, j] + V[i, 1] * B[1, j] + V[i, 2] * B[2, j]


@kernel
def run_adjoints(model: LinearModel, chain: Chain, rows: Float) -> None:
    """Replace the rows B (N+1, 3, n) of all scans by the adjoints b_k of the heading."""
    ahead, P, T = np.zeros((3, rows.shape[2])), chain.P, chain.T
    for k in range(len(rows) - 1, -1, -1):
        fx, fy = (model.lever[k + 1, 0], model.lever[k + 1, 1]) if k + 1 < len(rows) else (0.0, 0.0)
        for j in range(rows.shape[2]):
            a0, a1 = ahead[0, j], ahead[1, j]
            a2 = ahead[2, j] + fx * a0 + fy * a1
            x = P[k, 0, 0] * a0 + P[k, 0, 1] * a1 + P[k, 0, 2] * a2
            y = P[k, 1, 0] * a0 + P[k, 1, 1] * a1 + P[k, 1, 2] * a2
            t = P[k, 2, 0] * a0 + P[k, 2, 1] * a1 + P[k, 2, 2] * a2
            b0 = rows[k, 0, j] - T[k, 0, 0] * x - T[k, 0, 1] * y - T[k, 0, 2] * t
            b1 = rows[k, 1, j] - T[k, 1, 0] * x - T[k, 1, 1] * y - T[k, 1, 2] * t
            b2 = rows[k, 2, j] - T[k, 2, 0] * x - T[k, 2, 1] * y - T[k, 2, 2] * t
            ahead[0, j] = rows[k, 0, j] = a0 + T[k, 0, 0] * b0 + T[k, 1, 0] * b1 + T[k, 2, 0] * b2
            ahead[1, j] = rows[k, 1, j] = a1 + T[k, 0, 1] * b0 + T[k, 1, 1] * b1 + T[k, 2, 1] * b2
            ahead[2, j] = rows[k, 2, j] = a2 + T[k, 0, 2] * b0 + T[k, 1, 2] * b1 + T[k, 2, 2] * b2


@kernel
def smooth_covariances(model: LinearModel, chain: Chain, covs: Float) -> None:
    """Compute the covariances (N+1, 3, 3) of all poses given the unknowns and all scans.

    With the covariance U = P - P T' T P after the scan, and the information C of later scans about it, they are
    U - U C U.
    """
    V, U, C, D, half = np.zeros((5, 3, 3))
    for k in range(len(covs) - 1, -1, -1):
        P, T = chain.P[k], chain.T[k]
        multiply(P, T.T, V)
        multiply(V, V.T, half)
        for i in range(3):
            for j in range(3):
                U[i, j] = P[i, j] - half[i, j]
        multiply(U, C, half)
        multiply(half, U, D)
        for i in range(3):
            for j in range(3):
                covs[k, i, j] = U[i, j] - 0.5 * (D[i, j] + D[j, i])
        if k == 0:
            return
        multiply(V, T, D)
        for i in range(3):
            for j in range(3):
                D[i, j] = (1.0 if i == j else 0.0) - D[i, j]
        multiply(C, D, half)  # information about this pose before its scan: T' T + D' C D with D = I - P T' T
        multiply(D.T, half, C)
        for i in range(3):
            for j in range(3):
                for n in range(3):
                    C[i, j] += T[n, i] * T[n, j]
        for j in range(3):  # F' C F: information about the pose before
            C[2, j] += model.lever[k, 0] * C[0, j] + model.lever[k, 1] * C[1, j]
        for i in range(3):
            C[i, 2] += C[i, 0] * model.lever[k, 0] + C[i, 1] * model.lever[k, 1]


@inner
def multiply(A: Float, B: Float, out: Float) -> None:
    """Compute `out` = A B for 3 x 3 matrices; `out` must not be A or B."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
