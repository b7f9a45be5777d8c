"""Scans reduced to three equations of their pose, and the recursions over a chain of scans.

A scan of m observations depends on only three numbers of its pose. It is reduced to three equations
G dx + X (dm, 1) = unit noise; its other equations do not contain the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.solver.recursions import FilterCovariances, run_covariances, run_maps

CHUNK = 128  # steps that are processed together; their rows take a few megabytes


class Damping(NamedTuple):
    """Levenberg-Marquardt damping: information added to poses with scans, landmarks and motions."""

    pose: Float  # (3,) [1/m^2, 1/m^2, 1/rad^2]
    landmark: float  # [1/m^2]
    motion: float  # relative to the information of start and motions


NOT_DAMPED = Damping(np.zeros(3), 0.0, 0.0)


def compressed_scans(model: LinearModel, landmarks: int, damping: Damping, unknowns: int) -> tuple[Float, Float]:
    """Return three equations per scan, G dx + X (u, 1) = unit noise: G (N+1, 3, 3), X (N+1, 3, n+1).

    A QR decomposition removes the pose from all but the first three equations of a scan; damping adds three equations.
    The n unknowns u are dm, followed by unknowns that scans do not observe.
    """
    poses, (count, dim) = len(model.F) + 1, model.r.shape
    first = np.searchsorted(model.step, np.arange(poses + 1))
    place = np.arange(count) - first[model.step]  # index within the scan
    damped = np.diag(np.sqrt(damping.pose))
    G, X = np.empty((poses, 3, 3)), np.zeros((poses, 3, unknowns + 1))
    by_landmark = X[:, :, : 2 * landmarks].reshape(poses, 3, landmarks, 2).swapaxes(1, 2)
    for part in chunks(poses):
        scans = len(G[part])
        rows = slice(first[part.start], first[part.start + scans])
        step, at = model.step[rows], (model.step[rows] - part.start, place[rows])
        by_pose = np.zeros((scans, int(place[rows].max(initial=-1)) + 1, dim, 3))
        by_pose[at] = model.Hx[rows]
        rows_of_scan = np.concatenate([np.tile(damped, (scans, 1, 1)), by_pose.reshape(scans, -1, 3)], axis=1)
        Q, G[part] = np.linalg.qr(rows_of_scan)
        to_rows = transposed(Q[:, 3:].reshape(by_pose.shape)[at])
        np.add.at(by_landmark, (step, model.slot[rows]), to_rows @ model.Hm[rows])
        X[part, :, -1:] = _sum_by(at[0], to_rows @ model.r[rows, :, None], scans)
    return G, X


def landmarks_alone(model: LinearModel, landmarks: int, unknowns: int) -> Float:
    """Return the information (n+1, n+1) of all observations about (u, 1), for fixed poses."""
    joint = np.zeros((unknowns + 1, unknowns + 1))
    width = 2 * landmarks
    own = joint[:width, :width].reshape(landmarks, 2, landmarks, 2)
    index = np.arange(landmarks)
    by_landmark = transposed(model.Hm)
    own[index, :, index, :] = _sum_by(model.slot, by_landmark @ model.Hm, landmarks)
    joint[:width, -1] = _sum_by(model.slot, by_landmark @ model.r[:, :, None], landmarks).ravel()
    return joint


def own_information(model: LinearModel, landmarks: int) -> Float:
    """Return the information (2L,) about each landmark coordinate, given all other unknowns."""
    return _sum_by(model.slot, np.square(model.Hm).sum(axis=1)[:, :, None], landmarks).ravel()


def subtract_scans(joint: Float, X: Float, model: LinearModel) -> None:
    """Subtract X'X from `joint` in chunks, on the columns of the landmarks that each chunk observes."""
    for steps in chunks(len(X)):
        begin, end = np.searchsorted(model.step, [steps.start, steps.stop])
        seen = np.unique(model.slot[begin:end])
        columns = np.append((2 * seen[:, None] + np.arange(2)).ravel(), len(joint) - 1)
        joint[np.ix_(columns, columns)] -= gram(X[steps][:, :, columns])


def filter_covariances(model: LinearModel, G: Float) -> FilterCovariances:
    """Return covariances and gains of the Kalman filter over scans G (N+1, 3, 3)."""
    filtered = FilterCovariances(*np.empty((5, len(G), 3, 3)))
    run_covariances(np.array(model.start_cov), model.F, model.W, np.ascontiguousarray(G), filtered)
    return filtered


def filter_maps(start: Float, c: Float, X: Float, carry: Float, gain: Float) -> Float:
    """Return predicted poses as affine maps A (N+1, 3, n+1) of (u, 1); the first is `start` (3, n+1)."""
    A = np.empty_like(X)
    A[0] = start
    np.matmul(-gain[:-1], X[:-1], out=A[1:])
    A[1:, :, -1] += c
    run_maps(carry, A)
    return A


def chunks(steps: int) -> list[slice]:
    """Return slices of up to CHUNK steps."""
    return [slice(first, first + CHUNK) for first in range(0, steps, CHUNK)]


def _sum_by(group: Int, rows: Float, groups: int) -> Float:
    """Return sums (groups, a, b) of the matrices `rows` (M, a, b) of each group."""
    entries = rows.shape[1] * rows.shape[2]
    sums = np.empty((groups, entries))
    for column, values in enumerate(rows.reshape(len(rows), entries).T):
        sums[:, column] = np.bincount(group, values, groups)
    return sums.reshape(groups, *rows.shape[1:])


def gram(blocks: Float) -> Float:
    """Return the sum of B'B over the blocks (n, 3, width)."""
    rows = blocks.reshape(-1, blocks.shape[2])
    return rows.T @ rows


def transposed(matrices: Float) -> Float:
    """Return the transposes (..., b, a) of matrices (..., a, b)."""
    return matrices.swapaxes(-1, -2)
