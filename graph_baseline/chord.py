"""Compiled recursions of an optimum that grows pose by pose: what poses leave to the landmarks, and chord steps.

Given the landmarks, the poses are a Markov chain. With x_k = the error of pose k (world, additive), N(., P_k) what the
steps before say of it, and M_k its sensitivity to the landmarks m,

    predict  M <- F M,  P <- F P F' + W;   scan  B = Hx M + Hm, S = I + Hx P Hx', Lambda <- Lambda + B' S^-1 B,
             M <- M - K B,  P <- P - K S K',  K = P Hx' S^-1

leave the information Lambda of the landmarks, the Schur complement of the poses. No covariance is inverted, so that
motions of zero variance and a fixed start are exact, and nothing is subtracted from Lambda.

A chord step takes the gradient of the exact cost where the path and the map stand, and the matrices where they were
taken in (`linearised`): it costs a few hundred operations a pose instead of a product of L x L matrices, and where it
comes to rest the gradient is zero, so that stale matrices cost steps but no accuracy. In place of the gradient by the
poses, which zero variances make infinite, it takes the multipliers l_k of the steps that lead to them, and what the
step's noise w_k lacks of W_k l_k. Poses without a scan cost some ten times less than those with one.

Source: the recursions are those of a fixed-interval smoother with unknown parameters (Bierman, "Factorization methods
for discrete sequential estimation", 1977, chapter X); the step that keeps its matrix is Shamanskii's (1967).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compiled import inner, kernel
from slamgauge.graph_baseline.small import (
    add_identity,
    copy,
    factorise,
    gram,
    invert,
    multiply,
    product,
    product_transposed,
    symmetrise,
)

RANGE_BEARING, POSITION, BEARING = range(3)
CHUNK = 384  # rows whose products are taken together
SENSORS = {"range-bearing": RANGE_BEARING, "position": POSITION, "bearing": BEARING}


class Measured(NamedTuple):
    """A recording as the kernels take it; `slot` is -1 for an observation that is not taken in yet."""

    sensor: int
    start: Float  # (3,) prior mean
    motion: Float  # (N+1, 3) increment that leads to pose k; 0 for the first
    motion_cov: Float  # (N+1, 3, 3) in the body frame; the prior's for the first
    first: Int  # (N+2,) row of pose k's first observation
    value: Float  # (M, d)
    whitener: Float  # (M, d, d) lower triangular L^-1 of the covariance L L'
    slot: Int  # (M,)


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


class Chord(NamedTuple):
    """A step, and what its recursions leave for one another."""

    pose: Float  # (N+1, 3)
    landmark: Float  # (L, 2) the step; before, the gradient of minus the cost
    pull: Float  # (N+1, 3) gradient of minus the cost that the landmarks' step adds
    defect: Float  # (N+1, 3) W l - w
    mean: Float  # (N+1, 3)


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


def allocate_chord(poses: int, landmarks: int) -> Chord:
    """Room for a step."""
    pull, defect, mean = np.zeros((3, poses, 3))
    return Chord(np.zeros((poses, 3)), np.zeros((landmarks, 2)), pull, defect, mean)


@inner
def log_se2(x: float, y: float, t: float) -> tuple[float, float]:
    """Translation of the logarithm of the increment (x, y, t) of SE(2)."""
    half = 0.5 * t
    cotangent = 1.0 - half * half / 3.0 if abs(half) < 1e-4 else half / math.tan(half)
    return cotangent * x + half * y, cotangent * y - half * x


@inner
def wrap(angle: float) -> float:
    """The angle [rad] in [-pi, pi]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@inner
def step_noise(start: Float, motion: Float, end: Float, w: Float, B: Float) -> None:
    """The noise w (3,) of a step from pose `start` to `end` in the world, and B (3, 3), its Jacobian by the residual.

    The residual is Log(measured^-1 between) ~ N(0, Q), and B is R(end) times SE(2)'s right Jacobian.
    """
    c, s = math.cos(start[2]), math.sin(start[2])
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = c * dx + s * dy - motion[0], c * dy - s * dx - motion[1]
    turn = wrap(end[2] - start[2] - motion[2])
    c, s = math.cos(motion[2]), math.sin(motion[2])
    rx, ry = log_se2(c * x + s * y, c * y - s * x, turn)
    c, s = math.cos(end[2]), math.sin(end[2])
    w[0], w[1], w[2] = c * rx - s * ry, s * rx + c * ry, turn
    if abs(turn) < 1e-2:
        sine = 1.0 - turn * turn / 6.0 + turn**4 / 120.0
        versine = 0.5 * turn - turn**3 / 24.0
        b = 0.5 - turn * turn / 24.0
        a = turn / 6.0 - turn**3 / 120.0
    else:
        sine, versine = math.sin(turn) / turn, 2.0 * math.sin(0.5 * turn) ** 2 / turn
        b, a = versine / turn, (turn - math.sin(turn)) / (turn * turn)
    j02, j12 = a * rx - b * ry, b * rx + a * ry
    B[0, 0], B[0, 1], B[0, 2] = c * sine + s * versine, c * versine - s * sine, c * j02 - s * j12
    B[1, 0], B[1, 1], B[1, 2] = s * sine - c * versine, s * versine + c * sine, s * j02 + c * j12
    B[2, 0], B[2, 1], B[2, 2] = 0.0, 0.0, 1.0


@inner
def observe(measured: Measured, row: int, pose: Float, m: Float, r: Float, Hx: Float, Hm: Float) -> None:
    """Whitened residual h - z (d,) and Jacobians (d, 3), (d, 2) of an observation of the landmark m from a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ex, ey = m[0] - pose[0], m[1] - pose[1]
    x, y = c * ex + s * ey, c * ey - s * ex
    z, whitener = measured.value[row], measured.whitener[row]
    squared = x * x + y * y
    distance = math.sqrt(squared)
    if measured.sensor == POSITION:
        r0, r1, a00, a01, a10, a11 = x - z[0], y - z[1], 1.0, 0.0, 0.0, 1.0
    elif measured.sensor == RANGE_BEARING:
        r0, r1 = distance - z[0], wrap(math.atan2(y, x) - z[1])
        a00, a01, a10, a11 = x / distance, y / distance, -y / squared, x / squared
    else:
        r0, r1, a00, a01, a10, a11 = wrap(math.atan2(y, x) - z[0]), 0.0, -y / squared, x / squared, 0.0, 0.0
    for i in range(len(z)):
        w0 = whitener[i, 0]
        w1 = whitener[i, 1] if i == 1 else 0.0
        r[i] = w0 * r0 + w1 * r1
        ax, ay = w0 * a00 + w1 * a10, w0 * a01 + w1 * a11
        Hm[i, 0], Hm[i, 1] = ax * c - ay * s, ax * s + ay * c
        Hx[i, 0], Hx[i, 1] = -Hm[i, 0], -Hm[i, 1]
        Hx[i, 2] = Hm[i, 0] * ey - Hm[i, 1] * ex


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
def find_defects(measured: Measured, linear: Linear, place: Place, newest: int, chord: Chord) -> float:
    """Leave in `chord` the defects of all steps and the gradient by the landmarks, of the exact cost at `place`.

    Returns the relative change of the observations' Jacobians since they were taken in.
    """
    poses, places = place
    chord.landmark[:] = 0.0
    chord.pull[: newest + 1] = 0.0
    r, Hx, Hm = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    w, B, t, Qt = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    l0, l1, l2 = 0.0, 0.0, 0.0
    moved, norm = 0.0, 0.0
    for k in range(newest, -1, -1):
        if k < newest:
            l2 += (poses[k, 1] - poses[k + 1, 1]) * l0 + (poses[k + 1, 0] - poses[k, 0]) * l1
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            observe(measured, row, poses[k], places[slot], r, Hx, Hm)
            for i in range(measured.value.shape[1]):
                l0 -= Hx[i, 0] * r[i]
                l1 -= Hx[i, 1] * r[i]
                l2 -= Hx[i, 2] * r[i]
                chord.landmark[slot, 0] -= Hm[i, 0] * r[i]
                chord.landmark[slot, 1] -= Hm[i, 1] * r[i]
                for j in range(2):
                    moved += (Hm[i, j] - linear.Hm[row, i, j]) ** 2
                    norm += Hm[i, j] ** 2
        start = measured.start if k == 0 else poses[k - 1]
        step_noise(start, measured.motion[k], poses[k], w, B)
        Q = measured.motion_cov[k]
        for i in range(3):
            t[i] = B[0, i] * l0 + B[1, i] * l1 + B[2, i] * l2
        for i in range(3):
            Qt[i] = Q[i, 0] * t[0] + Q[i, 1] * t[1] + Q[i, 2] * t[2]
        for i in range(3):
            chord.defect[k, i] = B[i, 0] * Qt[0] + B[i, 1] * Qt[1] + B[i, 2] * Qt[2] - w[i]
    return math.sqrt(moved / norm) if norm > 0.0 else 0.0


@kernel
def smooth(linear: Linear, newest: int, chord: Chord) -> None:
    """Leave in `chord` the step of every pose that answers its defects and pulls, the landmarks standing still."""
    mean, G, P, N = chord.mean, linear.G, linear.P, linear.N
    x, ahead, total = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(newest + 1):
        if k > 0:
            x[0] += linear.lever[k, 0] * x[2]
            x[1] += linear.lever[k, 1] * x[2]
        for i in range(3):
            x[i] += chord.defect[k, i]
        for i in range(3):
            mean[k, i] = total[i] = x[i]
            for j in range(3):
                total[i] += P[k, i, j] * chord.pull[k, j]
        multiply(G[k], total, x)
    for k in range(newest, -1, -1):
        if k < newest:
            ahead[2] += linear.lever[k + 1, 0] * ahead[0] + linear.lever[k + 1, 1] * ahead[1]
        for i in range(3):
            ahead[i] += chord.pull[k, i]
        for i in range(3):
            total[i] = mean[k, i]
            for j in range(3):
                total[i] += P[k, i, j] * ahead[j]
        multiply(G[k], total, chord.pose[k])
        for i in range(3):
            for j in range(3):
                ahead[i] -= N[k, i, j] * chord.pose[k, j]


@kernel
def pull_landmarks(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Add to the landmarks' gradient what the poses' step does to it: -Hm' Hx step."""
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            for i in range(measured.value.shape[1]):
                h = linear.Hx[row, i]
                seen = h[0] * chord.pose[k, 0] + h[1] * chord.pose[k, 1] + h[2] * chord.pose[k, 2]
                for j in range(2):
                    chord.landmark[slot, j] -= linear.Hm[row, i, j] * seen


@kernel
def pull_poses(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Leave as pulls on the poses what the landmarks' step does to their gradients: -Hx' Hm step."""
    chord.pull[: newest + 1] = 0.0
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            for i in range(measured.value.shape[1]):
                h = linear.Hm[row, i]
                seen = h[0] * chord.landmark[slot, 0] + h[1] * chord.landmark[slot, 1]
                for j in range(3):
                    chord.pull[k, j] -= linear.Hx[row, i, j] * seen


@kernel
def move(measured: Measured, linear: Linear, place: Place, newest: int, landmarks: int, chord: Chord) -> float:
    """Move path and map by a chord step, each point by V(turn) step, V(t) = (R(t) - I) / (t J).

    A turn of everything about any point then keeps all distances, which an additive step would stretch. A landmark
    turns as do, in the mean, the poses that see it.
    """
    turns, seen, observed = np.zeros(landmarks), np.zeros(landmarks), 0.0
    for k in range(newest + 1):
        turn = chord.pose[k, 2]
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            turns[slot] += turn
            seen[slot] += 1.0
            for i in range(measured.value.shape[1]):
                change = linear.Hm[row, i, 0] * chord.landmark[slot, 0] + linear.Hm[row, i, 1] * chord.landmark[slot, 1]
                for j in range(3):
                    change += linear.Hx[row, i, j] * chord.pose[k, j]
                observed += change * change
        move_point(place.poses[k], chord.pose[k], turn)
        place.poses[k, 2] = wrap(place.poses[k, 2] + turn)
    for slot in range(landmarks):
        move_point(place.landmarks[slot], chord.landmark[slot], turns[slot] / max(seen[slot], 1.0))
    return math.sqrt(observed)


@inner
def move_point(point: Float, step: Float, turn: float) -> None:
    """Point <- point + V(turn) step."""
    along = math.sin(turn) / turn if turn != 0.0 else 1.0
    across = 2.0 * math.sin(0.5 * turn) ** 2 / turn if turn != 0.0 else 0.0
    point[0] += along * step[0] - across * step[1]
    point[1] += across * step[0] + along * step[1]
