"""What poses leave to the landmarks, compiled: the linear problem of an optimum that grows pose by pose.

Given the landmarks, the poses are a Markov chain. With x_k = the error of pose k (world, additive), N(., P_k) what the
steps before say of it, and M_k its sensitivity to the landmarks m,

    predict  M <- F M,  P <- F P F' + W;   scan  B = Hx M + Hm, S = I + Hx P Hx', Lambda <- Lambda + B' S^-1 B,
             M <- M - K B,  P <- P - K S K',  K = P Hx' S^-1

leave the information Lambda of the landmarks, the Schur complement of the poses. No covariance is inverted, so that
motions of zero variance and a fixed start are exact, and nothing is subtracted from Lambda. Poses without a scan cost
some ten times less than those with one.

Source: the recursions are those of a fixed-interval smoother with unknown parameters (Bierman, "Factorization methods
for discrete sequential estimation", 1977, chapter X).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compiled import inner, kernel
from slamgauge.graph_baseline.models import Measured, observe, step_noise
from slamgauge.graph_baseline.three_by_three import (
    add_identity,
    copy,
    factorise,
    gram,
    invert,
    product,
    product_transposed,
    symmetrise,
)

CHUNK = 384  # rows whose products are taken together


class Place(NamedTuple):
    """A path and a map; those in use come first."""

    poses: Float  # (N+1, 3)
    landmarks: Float  # (L, 2)


class Linear(NamedTuple):
    """Matrices of the poses that have been taken in, linearised where `at` says."""

    at: Place
    lever: Float  # (N+1, 2) of F = [I, lever; 0, 1], which leads to pose k
    P: Float  # (N+1, 3, 3) predicted
    N: Float  # (N+1, 3, 3) Hx' Hx of the scan
    G: Float  # (N+1, 3, 3) (I + P N)^-1
    Hx: Float  # (M, d, 3) whitened
    Hm: Float  # (M, d, 2) whitened
    M: Float  # (3, 2L) of the newest pose, with its scan
    newest_cov: Float  # (3, 3) the same of P
    information: Float  # (2L, 2L) Lambda
    pull: Float  # (2L,) on the landmarks, of the newest scan's residuals
    kick: Float  # (3,) on the newest pose, given the landmarks


def allocate_place(poses: int, landmarks: int) -> Place:
    """Room for a path and a map."""
    return Place(np.zeros((poses, 3)), np.zeros((landmarks, 2)))


def allocate_linear(poses: int, landmarks: int, observations: int, dim: int) -> Linear:
    """Room for the matrices of all poses, and of observations (M, dim)."""
    width = 2 * landmarks
    return Linear(
        at=allocate_place(poses, landmarks),
        lever=np.zeros((poses, 2)),
        P=np.zeros((poses, 3, 3)),
        N=np.zeros((poses, 3, 3)),
        G=np.zeros((poses, 3, 3)),
        Hx=np.zeros((observations, dim, 3)),
        Hm=np.zeros((observations, dim, 2)),
        M=np.zeros((3, width)),
        newest_cov=np.zeros((3, 3)),
        information=np.zeros((width, width)),
        pull=np.zeros(width),
        kick=np.zeros(3),
    )


@kernel
def take_in(
    measured: Measured, linear: Linear, place: Place, before: Place, landmarks: int, since: int, until: int
) -> None:
    """Take in the poses since..until-1 and their scans, linearised where `linear.at` says.

    Leaves in `pull` and `kick` what the residuals of the last of them do, taken at `place` and carried to `before`,
    where the steps before expect its pose and the map.
    """
    width = 2 * landmarks
    rows, used = np.empty((CHUNK, width)), 0
    for k in range(since, until):
        linear.pull[:width] = 0.0
        linear.kick[:] = 0.0
        predict(measured, linear, width, k)
        copy(linear.newest_cov, linear.P[k])
        scan, slots = compressed_scan(measured, linear, place, before, k)
        if len(slots) == 0:
            linear.N[k] = 0.0
            linear.G[k] = 0.0
            add_identity(linear.G[k])
            continue
        add_landmarks_alone(linear, scan, slots)
        if used + 3 > CHUNK:
            add_information(linear, rows[:used], width)
            used = 0
        correct(linear, scan, slots, rows[used : used + 3], width, k)
        used += 3
    if used:
        add_information(linear, rows[:used], width)


@inner
def correct(linear: Linear, scan: Float, slots: Int, B: Float, width: int, k: int) -> None:
    """Correct M and P of pose k by the first three rows of its scan; leave their B (3, width), whitened."""
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
    for i in range(3):  # whiten: B, y and the gain by the root of S
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
            linear.kick[i] -= gain[i, n] * y[n]
            for j in range(3):
                P[i, j] -= gain[i, n] * gain[j, n]
            for j in range(width):
                M[i, j] -= gain[i, n] * B[n, j]
        for j in range(width):
            linear.pull[j] -= B[n, j] * y[n]


@inner
def prepare(P: Float, T: Float, N: Float, G: Float, gain: Float, root: Float) -> None:
    """N <- T'T, G <- (I + P N)^-1, the gain P T' not yet whitened, and the lower triangular root of S = I + T P T'."""
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
    """Lambda <- Lambda + B'B for whitened rows B (n, width)."""
    added = gram(rows)
    for i in range(width):
        for j in range(width):
            linear.information[i, j] += added[i, j]


@inner
def predict(measured: Measured, linear: Linear, width: int, k: int) -> None:
    """M <- F M, P <- F P F' + W of the step that leads to pose k."""
    poses, M, P = linear.at.poses, linear.M, linear.newest_cov
    w, B = np.empty(3), np.empty((3, 3))
    start = measured.start if k == 0 else poses[k - 1]
    step_noise(start, measured.motion[k], poses[k], w, B)
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


@inner
def compressed_scan(measured: Measured, linear: Linear, place: Place, before: Place, k: int) -> tuple[Float, Int]:
    """Rows [Hx, Hm of each landmark seen, residual] of a scan, turned so that from the fourth on Hx is zero; slots."""
    first, last, d = measured.first[k], measured.first[k + 1], measured.value.shape[1]
    slots, taken = np.empty(last - first, dtype=np.int64), 0
    for row in range(first, last):
        if measured.slot[row] >= 0:
            slots[taken] = measured.slot[row]
            taken += 1
    scan = np.zeros((max(3, d * taken), 4 + 2 * taken))
    residual, unused, n = np.empty(2), np.empty(2), 0
    for row in range(first, last):
        slot = measured.slot[row]
        if slot < 0:
            continue
        Hx, Hm = linear.Hx[row], linear.Hm[row]
        observe(measured, row, place.poses[k], place.landmarks[slot], residual, Hx, Hm)
        observe(measured, row, linear.at.poses[k], linear.at.landmarks[slot], unused, Hx, Hm)
        for i in range(d):
            of_row = scan[d * n + i]
            of_row[-1] = residual[i]
            for j in range(3):
                of_row[j] = Hx[i, j]
                of_row[-1] += Hx[i, j] * (before.poses[k, j] - place.poses[k, j])
            for j in range(2):
                of_row[3 + 2 * n + j] = Hm[i, j]
                of_row[-1] += Hm[i, j] * (before.landmarks[slot, j] - place.landmarks[slot, j])
        n += 1
    if d * taken > 3:
        for j in range(3):
            reflect(scan[j:], j)
    return scan, slots[:taken]


@inner
def reflect(rows: Float, column: int) -> None:
    """Turn the rows by a Householder reflection, so that of the column only the first entry is not zero."""
    v, along, squared = np.empty(len(rows)), np.zeros(rows.shape[1]), 0.0
    for i in range(len(rows)):
        v[i] = rows[i, column]
        squared += v[i] * v[i]
    if squared == 0.0:
        return
    v[0] += math.copysign(math.sqrt(squared), v[0])
    squared += v[0] * v[0] - rows[0, column] * rows[0, column]
    for i in range(len(rows)):
        for j in range(rows.shape[1]):
            along[j] += v[i] * rows[i, j]
    for i in range(len(rows)):
        for j in range(rows.shape[1]):
            rows[i, j] -= 2.0 * along[j] / squared * v[i]
    for i in range(1, len(rows)):
        rows[i, column] = 0.0


@inner
def add_landmarks_alone(linear: Linear, scan: Float, slots: Int) -> None:
    """Add what a scan says about its landmarks among themselves: its rows from the fourth on."""
    alone = np.empty((len(scan) - 3, scan.shape[1] - 3))
    for i in range(alone.shape[0]):
        for j in range(alone.shape[1]):
            alone[i, j] = scan[3 + i, 3 + j]
    added = gram(alone)
    for n in range(len(slots)):
        for i in range(2):
            for o in range(len(slots)):
                for j in range(2):
                    linear.information[2 * slots[n] + i, 2 * slots[o] + j] += added[2 * n + i, 2 * o + j]
            linear.pull[2 * slots[n] + i] -= added[2 * n + i, 2 * len(slots)]


@kernel
def newest_covariance(linear: Linear, factor: Float, cov: Float) -> None:
    """`cov` (3, 3) <- of the newest pose, P + M Lambda^-1 M', given the factor L of Lambda = L L' (2L, 2L)."""
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
