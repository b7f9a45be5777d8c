"""The linearised graph solved through its Schur complement: the step, and every covariance.

Given the landmarks m, the poses are a Markov chain, and everything about them is affine in m. One pass
forward (a Kalman filter whose mean is the 3 x (2L + 1) matrix of that affine map) gathers the landmarks'
information Lambda, the Schur complement of the poses; one pass back (modified Bryson-Frazier, which
inverts no covariance) smooths the chain. Then cov(m) = Lambda^-1, cov(x_k) = P_k + A_k Lambda^-1 A_k'.
Singular motion noise and a fixed start are exact: no covariance of a pose is ever inverted.

A scan of m observations meets its pose through three numbers only, so it is first compressed to three
equations G dx + X dm + g = unit noise; what else it says is about its landmarks alone.

Cost: O(N L^2) in two symmetric products, and recursions of 3 x 3 matrices; no matrix larger than (3N, 2L).
Source: Bierman, "Factorization methods for discrete sequential estimation" (1977), chapter X.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.factors import least_known_landmark, require_known_landmarks
from slamgauge.graph_baseline.linearisation import LinearModel, linearise
from slamgauge.graph_baseline.undetermined import undetermined_variable
from slamgauge.recording import Recording

CHUNK = 128  # steps whose rows, a few megabytes, are handled together


class Solution(NamedTuple):
    """Newton step and covariances of the linearised problem, additive world coordinates."""

    dx: Float  # (N+1, 3)
    dm: Float  # (L, 2)
    pose_covs: Float  # (N+1, 3, 3)
    landmark_covs: Float  # (L, 2, 2)


def solve_at(recording: Recording, landmark_ids: Int, poses: Float, landmarks: Float) -> Solution:
    """The recording's exact model linearised at `poses` (N+1, 3) and `landmarks` (L, 2), ids increasing, and solved.

    Raises:
        UndeterminedError: the observations do not determine the landmarks.
    """
    slot = np.searchsorted(landmark_ids, require_known_landmarks(recording))
    try:
        return solve(linearise(recording, slot, poses, landmarks), len(landmark_ids))
    except np.linalg.LinAlgError:
        raise undetermined_variable("l", least_known_landmark(recording)[0]) from None


def solve(model: LinearModel, landmarks: int) -> Solution:
    """Minimise the linear model over all poses and `landmarks` landmarks.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """
    G, X = _compressed_scans(model, landmarks)
    joint = _landmarks_alone(model, landmarks)
    _subtract_scans(joint, X, model)
    P, carry, gain = _filter_covariances(model, G)
    A = _filter_maps(model, X, carry, gain)
    whitener = np.linalg.inv(np.linalg.cholesky(np.eye(3) + G @ P @ _transposed(G)))
    observed = whitener @ G
    for steps in _chunks(len(A)):
        innovation = whitener[steps] @ (G[steps] @ A[steps] + X[steps])
        joint += _gram(innovation)
        X[steps] = _transposed(observed[steps]) @ innovation
    _smooth(A, P, carry, observed, adjoint=X)

    factor = np.asarray(np.linalg.cholesky(joint[:-1, :-1]), dtype=np.float64)
    dm = -cho_solve((factor, True), joint[:-1, -1])
    dx = A[:, :, :-1] @ dm + A[:, :, -1]
    for steps in _chunks(len(A)):
        maps = A[steps, :, :-1].reshape(3 * len(A[steps]), 2 * landmarks)
        spread = solve_triangular(factor, maps.T, lower=True, check_finite=False, overwrite_b=True)
        spread = spread.T.reshape(len(A[steps]), 3, 2 * landmarks)
        P[steps] += spread @ _transposed(spread)
    return Solution(dx, dm.reshape(-1, 2), P, _own_blocks_of_inverse(factor))


def _chunks(steps: int) -> list[slice]:
    """Slices that cover the steps."""
    return [slice(first, first + CHUNK) for first in range(0, steps, CHUNK)]


def _own_blocks_of_inverse(factor: Float) -> Float:
    """Diagonal blocks (L, 2, 2) of (factor factor')^-1."""
    root = solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
    even, odd = root[:, 0::2], root[:, 1::2]
    xx, xy, yy = ((one * other).sum(axis=0) for one, other in ((even, even), (even, odd), (odd, odd)))
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def _compressed_scans(model: LinearModel, landmarks: int) -> tuple[Float, Float]:
    """Three equations a scan, G dx + X (dm, 1) = unit noise: G (N+1, 3, 3), X (N+1, 3, 2L+1)."""
    poses = len(model.F) + 1
    by_pose = _transposed(model.Hx)
    value, axes = np.linalg.eigh(_sum_by(model.step, by_pose @ model.Hx, poses))
    value[value < 1e-13 * value[:, -1:]] = 0.0
    root = np.sqrt(value)
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    to_rows = inverse[:, :, None] * _transposed(axes)
    X = np.zeros((poses, 3, 2 * landmarks + 1))
    by_landmark = X[:, :, :-1].reshape(poses, 3, landmarks, 2).swapaxes(1, 2)
    np.add.at(by_landmark, (model.step, model.slot), to_rows[model.step] @ (by_pose @ model.Hm))
    X[:, :, -1:] = to_rows @ _sum_by(model.step, by_pose @ model.r[:, :, None], poses)
    return root[:, :, None] * _transposed(axes), X


def _landmarks_alone(model: LinearModel, landmarks: int) -> Float:
    """Information (2L+1, 2L+1) of all observations on (dm, 1), the poses held fixed."""
    joint = np.zeros((2 * landmarks + 1, 2 * landmarks + 1))
    own = joint[:-1, :-1].reshape(landmarks, 2, landmarks, 2)
    index = np.arange(landmarks)
    by_landmark = _transposed(model.Hm)
    own[index, :, index, :] = _sum_by(model.slot, by_landmark @ model.Hm, landmarks)
    joint[:-1, -1] = _sum_by(model.slot, by_landmark @ model.r[:, :, None], landmarks).ravel()
    return joint


def _subtract_scans(joint: Float, X: Float, model: LinearModel) -> None:
    """Subtract X'X, chunk by chunk on the columns of the landmarks that the chunk has seen."""
    for steps in _chunks(len(X)):
        begin, end = np.searchsorted(model.step, [steps.start, steps.stop])
        seen = np.unique(model.slot[begin:end])
        columns = np.append((2 * seen[:, None] + np.arange(2)).ravel(), len(joint) - 1)
        joint[np.ix_(columns, columns)] -= _gram(X[steps][:, :, columns])


def _filter_covariances(model: LinearModel, G: Float) -> tuple[Float, Float, Float]:
    """Kalman filter of a pose given the landmarks: predicted covariances P (N+1, 3, 3), carry F (I - K G), gain F K."""
    P, carry, gain = (np.empty((len(G), 3, 3)) for _ in range(3))
    P[0] = model.start_cov
    identity = np.eye(3)
    moves = np.concatenate([model.F, identity[None]])
    noises = np.concatenate([model.W, np.zeros((1, 3, 3))])
    for k, (g, F, W) in enumerate(zip(G, moves, noises, strict=True)):
        PG = P[k] @ g.T
        K = PG @ np.linalg.inv(identity + g @ PG)
        gain[k] = F @ K
        carry[k] = F - gain[k] @ g
        if k + 1 < len(G):
            following = F @ (P[k] - K @ PG.T) @ F.T + W
            P[k + 1] = (following + following.T) / 2
    return P, carry, gain


def _filter_maps(model: LinearModel, X: Float, carry: Float, gain: Float) -> Float:
    """Predicted poses as affine maps A (N+1, 3, 2L+1) of (dm, 1)."""
    A = np.empty_like(X)
    A[0] = 0.0
    A[0, :, -1] = model.start
    np.matmul(-gain[:-1], X[:-1], out=A[1:])
    A[1:, :, -1] += model.c
    for k in range(len(A) - 1):
        A[k + 1] += carry[k] @ A[k]
    return A


def _smooth(A: Float, P: Float, carry: Float, observed: Float, adjoint: Float) -> None:
    """Turn predicted maps A and covariances P into smoothed ones, in place (modified Bryson-Frazier).

    `adjoint` holds each scan's own part, observed' innovation, and is overwritten.
    """
    adjoint_cov = _transposed(observed) @ observed
    for k in range(len(A) - 2, -1, -1):
        adjoint[k] += carry[k].T @ adjoint[k + 1]
        adjoint_cov[k] += carry[k].T @ adjoint_cov[k + 1] @ carry[k]
    for steps in _chunks(len(A)):
        A[steps] -= P[steps] @ adjoint[steps]
        smoothed = P[steps] - P[steps] @ adjoint_cov[steps] @ P[steps]
        P[steps] = (smoothed + _transposed(smoothed)) / 2


def _sum_by(group: Int, rows: Float, groups: int) -> Float:
    """Sums (groups, a, b) of the matrices `rows` (M, a, b) that share a group."""
    entries = rows.shape[1] * rows.shape[2]
    sums = np.empty((groups, entries))
    for column, values in enumerate(rows.reshape(len(rows), entries).T):
        sums[:, column] = np.bincount(group, values, groups)
    return sums.reshape(groups, *rows.shape[1:])


def _gram(blocks: Float) -> Float:
    """Sum of B'B over the blocks (n, 3, width)."""
    rows = blocks.reshape(-1, blocks.shape[2])
    return rows.T @ rows


def _transposed(matrices: Float) -> Float:
    return matrices.swapaxes(-1, -2)
