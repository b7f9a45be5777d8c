"""Elimination of the poses of an incremental optimum, which leaves a linear system of its landmarks, compiled.

Given the landmarks, the poses are a Markov chain. Let x_k be the error of pose k (world frame, additive), P_k its
covariance given the earlier steps, and M_k its sensitivity to the landmarks m. The recursion

    predict  M <- F M,  P <- F P F' + W;   scan  B = Hx M + Hm, S = I + Hx P Hx', Lambda <- Lambda + B' S^-1 B,
             M <- M - K B,  P <- P - K S K',  K = P Hx' S^-1

computes the information Lambda of the landmarks, the Schur complement of the poses. No pose covariance is inverted, so
motions of zero variance and a fixed start are exact. Scans are reduced without subtracting information, except scans
with many observations of similar precision that exceeds the pose's by a few orders of magnitude at most: their
information about the landmarks is Hm'Hm minus the part that depends on the pose. A pose without a scan costs about a
tenth of a pose with one.

Source: the recursions are those of a fixed-interval smoother with unknown parameters (Bierman, "Factorization
methods for discrete sequential estimation", 1977, chapter X).
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.residuals import Measured, cosine_sine, step_residual
from slamgauge.graph_baseline.solver.linear_problem import Linear, State
from slamgauge.graph_baseline.solver.matrices_3x3 import (
    add_identity,
    copy,
    factorise,
    invert,
    product,
    product_transposed,
    symmetrise,
)
from slamgauge.graph_baseline.solver.scan_reduction import reduce_by_projection, reduce_by_reflections, scan_slots
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import right_jacobian

CHUNK = 384  # rows of B in one matrix product
BLOCK = 128  # columns of Lambda in one matrix product
MANY = 16  # observations; larger scans may be reduced by projection
ALIKE = 1e6  # largest ratio of the information of two observations, and of pose variance to observation variance


@kernel
def eliminate_poses(
    measured: Measured, linear: Linear, state: State, before: State, landmarks: int, steps: tuple[int, int]
) -> None:
    """Eliminate the poses steps[0]..steps[1]-1, linearised at `linear.at`, and add their scans to the information.

    Writes right-hand side and pose step of the last scan to `linear.rhs` and `linear.pose_step`. The residuals of this
    scan are computed at `state` and extrapolated to `before`: its pose and the map, predicted from earlier steps.
    """
    width = 2 * landmarks
    since, until = steps
    rows, used = np.empty((CHUNK, width)), 0
    for k in range(since, until):
        linear.rhs[:width] = 0.0
        linear.pose_step[:] = 0.0
        predict(measured, linear, width, k)
        copy(linear.newest_cov, linear.P[k])
        slots = scan_slots(measured, k)
        if len(slots) == 0:
            linear.N[k] = 0.0
            linear.G[k] = 0.0
            add_identity(linear.G[k])
            continue
        if len(slots) > MANY and have_similar_information(measured, linear, k):
            scan = reduce_by_projection(measured, linear, state, before, slots, k)
        else:
            scan = reduce_by_reflections(measured, linear, state, before, slots, k)
        if used + 3 > CHUNK:
            add_information(linear, rows[:used], width)
            used = 0
        correct(linear, scan, slots, rows[used : used + 3], width, k)
        used += 3
    if used:
        add_information(linear, rows[:used], width)


@inner
def have_similar_information(measured: Measured, linear: Linear, k: int) -> bool:
    """Return whether the reduction by projection keeps at least ten digits of a scan's information."""
    sharpest, dullest = 0.0, math.inf
    for row in range(measured.first[k], measured.first[k + 1]):
        if measured.slot[row] >= 0:
            information = np.sum(measured.whitener[row] ** 2)
            sharpest, dullest = max(sharpest, information), min(dullest, information)
    doubt = max(linear.newest_cov[0, 0], linear.newest_cov[1, 1])
    return sharpest <= ALIKE * dullest and sharpest * doubt <= ALIKE


@inner
def correct(linear: Linear, scan: Float, slots: Int, B: Float, width: int, k: int) -> None:
    """Correct M and P of pose k with the first three rows of its scan; write their whitened B (3, width)."""
    M, P = linear.M, linear.newest_cov
    T, y, gain, root = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        y[i] = scan[i, -1]
        for j in range(3):
            T[i, j] = scan[i, j]
    prepare(P, T, linear.N[k], linear.G[k], gain, root)
    for i in range(3):
        for j in range(width):
            B[i, j] = T[i, 0] * M[0, j] + T[i, 1] * M[1, j] + T[i, 2] * M[2, j]
        for n in range(len(slots)):
            B[i, 2 * slots[n]] += scan[i, 3 + 2 * n]
            B[i, 2 * slots[n] + 1] += scan[i, 4 + 2 * n]
    for i in range(3):  # whiten B, y and the gain with the root of S
        for n in range(i):
            y[i] -= root[i, n] * y[n]
            for j in range(3):
                gain[j, i] -= root[i, n] * gain[j, n]
            for j in range(width):
                B[i, j] -= root[i, n] * B[n, j]
        y[i] /= root[i, i]
        for j in range(3):
            gain[j, i] /= root[i, i]
        for j in range(width):
            B[i, j] /= root[i, i]
    for n in range(3):
        for i in range(3):
            linear.pose_step[i] -= gain[i, n] * y[n]
            for j in range(3):
                P[i, j] -= gain[i, n] * gain[j, n]
            for j in range(width):
                M[i, j] -= gain[i, n] * B[n, j]
        for j in range(width):
            linear.rhs[j] -= B[n, j] * y[n]


@inner
def prepare(P: Float, T: Float, N: Float, G: Float, gain: Float, root: Float) -> None:
    """Compute N = T'T, G = (I + P N)^-1, P T' (`gain`), and the lower triangular root of S = I + T P T'."""
    for i in range(3):
        for j in range(3):
            N[i, j] = T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j]
    product(P, N, root)
    add_identity(root)
    invert(root, G)
    product_transposed(P, T, gain)
    product(T, gain, root)
    add_identity(root)
    factorise(root)


@inner
def add_information(linear: Linear, rows: Float, width: int) -> None:
    """Add B'B to the information, for whitened rows B (n, width)."""
    columns = rows.T.copy()
    for first in range(0, width, BLOCK):
        last = min(first + BLOCK, width)
        added = np.dot(columns[first:], columns[first:last].T)
        for i in range(first, width):
            for j in range(first, last):
                linear.information[i, j] += added[i - first, j - first]


@inner
def predict(measured: Measured, linear: Linear, width: int, k: int) -> None:
    """Predict pose k: M <- F M, P <- F P F' + W."""
    poses, M, P = linear.at.poses, linear.M, linear.newest_cov
    B = np.zeros((3, 3))
    start = measured.start if k == 0 else poses[k - 1]
    x, y, t = step_residual(start, cosine_sine(start), measured.motion[k], measured.motion_turn[k], poses[k])
    j00, j01, j02, j12 = right_jacobian(x, y, t)
    c, s = cosine_sine(poses[k])
    B[0, 0], B[0, 1], B[0, 2] = c * j00 + s * j01, c * j01 - s * j00, c * j02 - s * j12
    B[1, 0], B[1, 1], B[1, 2] = s * j00 - c * j01, s * j01 + c * j00, s * j02 + c * j12
    B[2, 2] = 1.0
    BQ, W = np.empty((3, 3)), np.empty((3, 3))
    product(B, measured.motion_cov[k], BQ)
    product_transposed(BQ, B, W)
    symmetrise(W)
    if k == 0:
        copy(W, P)
        M[:] = 0.0
        return
    fx, fy = poses[k - 1, 1] - poses[k, 1], poses[k, 0] - poses[k - 1, 0]
    linear.lever[k, 0], linear.lever[k, 1] = fx, fy
    for j in range(3):
        P[0, j] += fx * P[2, j]
        P[1, j] += fy * P[2, j]
    for i in range(3):
        P[i, 0] += fx * P[i, 2]
        P[i, 1] += fy * P[i, 2]
    for i in range(3):
        for j in range(3):
            P[i, j] += W[i, j]
    for j in range(width):
        M[0, j] += fx * M[2, j]
        M[1, j] += fy * M[2, j]


@kernel
def newest_covariance(linear: Linear, factor: Float, cov: Float) -> None:
    """Compute `cov` (3, 3) = P + M Lambda^-1 M' of the newest pose from the Cholesky factor (2L, 2L) of Lambda."""
    width = len(factor)
    spread = np.empty((3, width))  # M L'^-1
    for i in range(width):
        s0, s1, s2 = linear.M[0, i], linear.M[1, i], linear.M[2, i]
        for j in range(i):
            s0 -= factor[i, j] * spread[0, j]
            s1 -= factor[i, j] * spread[1, j]
            s2 -= factor[i, j] * spread[2, j]
        spread[0, i], spread[1, i], spread[2, i] = s0 / factor[i, i], s1 / factor[i, i], s2 / factor[i, i]
    for i in range(3):
        for j in range(3):
            cov[i, j] = linear.newest_cov[i, j]
            for n in range(width):
                cov[i, j] += spread[i, n] * spread[j, n]
    symmetrise(cov)
