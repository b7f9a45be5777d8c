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

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.chain import Chain, shear, shorten
from slamgauge.graph_baseline.factors import least_known_landmark, require_known_landmarks
from slamgauge.graph_baseline.linearisation import LinearModel, linearise
from slamgauge.graph_baseline.recursions import run_adjoints, run_covariances, run_maps
from slamgauge.graph_baseline.undetermined import undetermined_variable
from slamgauge.graph_baseline.warm_up import compile_graphs_once
from slamgauge.recording import Recording

CHUNK = 128  # steps whose rows, a few megabytes, are handled together


EXHAUSTED = 1e-12  # share of a landmark's information that rounding hides


class Solution(NamedTuple):
    """Newton step and covariances of the linearised problem, additive world coordinates."""

    dx: Float  # (N+1, 3)
    dm: Float  # (L, 2)
    pose_covs: Float  # (N+1, 3, 3)
    landmark_covs: Float  # (L, 2, 2)


class Damping(NamedTuple):
    """Information that holds poses with scans, landmarks and motions where they are (Levenberg and Marquardt)."""

    pose: Float  # (3,) [1/m^2, 1/m^2, 1/rad^2]
    landmark: float  # [1/m^2]
    motion: float  # over what the noise of start and motions says of itself


NOT_DAMPED = Damping(np.zeros(3), 0.0, 0.0)


class Elimination(NamedTuple):
    """The keys of a chain as affine maps of (dm, 1), and what the landmarks know."""

    A: Float  # (K, 3, 2L+1) predicted
    P: Float  # (K, 3, 3) their covariances, given the landmarks
    updated: Float  # (K, 3, 3) the same with the key's own scan
    adjoint: Float  # (K, 3, 2L+1) smoothed A: A - P adjoint
    adjoint_cov: Float  # (K, 3, 3) smoothed P: P - P adjoint_cov P
    factor: Float  # (2L, 2L) lower triangular: information of the landmarks
    dm: Float  # (2L,)


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
    chain = shorten(model)
    eliminated = _eliminate(chain, landmarks, NOT_DAMPED)
    pose_covs = np.empty((len(model.F) + 1, 3, 3))
    for poses, A, P in _smoothed_maps(chain, eliminated):
        maps = A[:, :, :-1].reshape(3 * len(A), 2 * landmarks)
        spread = solve_triangular(eliminated.factor, maps.T, lower=True, check_finite=False, overwrite_b=True)
        spread = spread.T.reshape(len(A), 3, 2 * landmarks)
        pose_covs[poses] = P + spread @ _transposed(spread)
    dx, dm = _newton_step(chain, eliminated)
    return Solution(dx, dm, pose_covs, own_blocks_of_inverse(eliminated.factor))


def damped_step(model: LinearModel, landmarks: int, damping: Damping) -> tuple[Float, Float]:
    """The step (N+1, 3), (L, 2) alone, held back by `damping`; raises as `solve`.

    |w + dw|^2 + d |dw|^2 is (1 + d) |dw + w / (1 + d)|^2 but for a constant: a motion of smaller noise.
    """
    share = 1.0 / (1.0 + damping.motion)
    chain = shorten(
        model._replace(
            start=share * model.start, start_cov=share * model.start_cov, c=share * model.c, W=share * model.W
        )
    )
    return _newton_step(chain, _eliminate(chain, landmarks, damping))


def _eliminate(chain: Chain, landmarks: int, damping: Damping) -> Elimination:
    compile_graphs_once()
    model = chain.model
    G, X = compressed_scans(model, landmarks, damping)
    joint = _landmarks_alone(model, landmarks)
    joint[np.diag_indices(2 * landmarks)] += damping.landmark
    own = np.diag(joint)[:-1].copy()
    _subtract_scans(joint, X, model)
    P, updated, carry, gain, whitener = filter_covariances(model, G)
    A = filter_maps(model, X, carry, gain)
    observed = whitener @ G
    for steps in _chunks(len(A)):
        innovation = whitener[steps] @ (G[steps] @ A[steps] + X[steps])
        joint += _gram(innovation)
        X[steps] = _transposed(observed[steps]) @ innovation
    adjoint_cov = _transposed(observed) @ observed
    run_adjoints(carry, X, adjoint_cov)
    factor = np.asarray(np.linalg.cholesky(joint[:-1, :-1]), dtype=np.float64)
    if (np.square(np.diag(factor)) < EXHAUSTED * own).any():
        raise np.linalg.LinAlgError("what poses leave of a landmark's information is rounding")
    dm = -cho_solve((factor, True), joint[:-1, -1])
    return Elimination(A, P, updated, X, adjoint_cov, factor, dm)


def _newton_step(chain: Chain, eliminated: Elimination) -> tuple[Float, Float]:
    """The step of all poses (N+1, 3) and landmarks (L, 2)."""
    at = np.append(eliminated.dm, 1.0)
    predicted, adjoint = eliminated.A @ at, eliminated.adjoint @ at
    dx = np.empty((chain.key[-1] + 1, 3))
    dx[chain.key] = predicted - np.einsum("kij,kj->ki", eliminated.P, adjoint)
    between = chain.between
    if len(between.pose):
        before, P = between.key - 1, _predicted_between(chain, eliminated, slice(None))
        start = predicted[between.key] - chain.model.c[before]
        start[:, :2] -= between.lever_to * start[:, 2:]
        pull = adjoint[between.key]
        pull[:, 2] += (between.lever_to * pull[:, :2]).sum(axis=1)
        dx[between.pose] = start + between.c - np.einsum("kij,kj->ki", P, pull)
    return dx, eliminated.dm.reshape(-1, 2)


def _smoothed_maps(chain: Chain, eliminated: Elimination) -> Iterator[tuple[Int, Float, Float]]:
    """Poses (n,), chunk by chunk, their smoothed maps (n, 3, 2L+1), and covariances (n, 3, 3) given the landmarks."""
    for part in _chunks(len(chain.key)):
        P, adjoint = eliminated.P[part], eliminated.adjoint[part]
        later = _carried_back(chain.model.F, eliminated.adjoint_cov, part)
        yield chain.key[part], eliminated.A[part] - P @ adjoint, _smoothed_covariances(eliminated.updated[part], later)
    between = chain.between
    for part in _chunks(len(between.pose)):
        key, lever = between.key[part], between.lever_to[part]
        P = _predicted_between(chain, eliminated, part)
        A = eliminated.A[key]
        A[:, :, -1] -= chain.model.c[key - 1]
        A[:, :2] -= lever[:, :, None] * A[:, 2:]
        A[:, :, -1] += between.c[part]
        adjoint = eliminated.adjoint[key]
        adjoint[:, 2] += np.einsum("ki,kij->kj", lever, adjoint[:, :2])
        adjoint_cov = eliminated.adjoint_cov[key]
        adjoint_cov[:, 2, :] += np.einsum("ki,kij->kj", lever, adjoint_cov[:, :2, :])
        adjoint_cov[:, :, 2] += np.einsum("ki,kji->kj", lever, adjoint_cov[:, :, :2])
        yield between.pose[part], A - P @ adjoint, _smoothed_covariances(P, adjoint_cov)


def _carried_back(F: Float, adjoint_cov: Float, part: slice) -> Float:
    """What the scans after a pose say of its covariance (n, 3, 3)."""
    back = np.zeros_like(adjoint_cov[part])
    move = F[part]
    back[: len(move)] = _transposed(move) @ adjoint_cov[part.start + 1 : part.start + 1 + len(move)] @ move
    return back


def _smoothed_covariances(P: Float, adjoint_cov: Float) -> Float:
    smoothed = P - P @ adjoint_cov @ P
    return (smoothed + _transposed(smoothed)) / 2


def _predicted_between(chain: Chain, eliminated: Elimination, part: slice) -> Float:
    """Covariances (n, 3, 3) of poses between keys, predicted from the key before."""
    between = chain.between
    P = eliminated.updated[between.key[part] - 1]
    shear(P, between.lever_from[part])
    return P + between.W[part]


def _chunks(steps: int) -> list[slice]:
    """Slices that cover the steps."""
    return [slice(first, first + CHUNK) for first in range(0, steps, CHUNK)]


def own_blocks_of_inverse(factor: Float) -> Float:
    """Diagonal blocks (L, 2, 2) of (factor factor')^-1."""
    root = solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
    even, odd = root[:, 0::2], root[:, 1::2]
    xx, xy, yy = ((one * other).sum(axis=0) for one, other in ((even, even), (even, odd), (odd, odd)))
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def compressed_scans(model: LinearModel, landmarks: int, damping: Damping) -> tuple[Float, Float]:
    """Three equations a scan, G dx + X (dm, 1) = unit noise: G (N+1, 3, 3), X (N+1, 3, 2L+1).

    They are the first of its equations, turned so that the others leave the pose out; damping makes three of them.
    """
    poses, (count, dim) = len(model.F) + 1, model.r.shape
    first = np.searchsorted(model.step, np.arange(poses + 1))
    place = np.arange(count) - first[model.step]  # within the scan
    held = np.diag(np.sqrt(damping.pose))
    G, X = np.empty((poses, 3, 3)), np.zeros((poses, 3, 2 * landmarks + 1))
    by_landmark = X[:, :, :-1].reshape(poses, 3, landmarks, 2).swapaxes(1, 2)
    for part in _chunks(poses):
        scans = len(G[part])
        rows = slice(first[part.start], first[part.start + scans])
        step, at = model.step[rows], (model.step[rows] - part.start, place[rows])
        by_pose = np.zeros((scans, int(place[rows].max(initial=-1)) + 1, dim, 3))
        by_pose[at] = model.Hx[rows]
        Q, G[part] = np.linalg.qr(np.concatenate([np.tile(held, (scans, 1, 1)), by_pose.reshape(scans, -1, 3)], axis=1))
        to_rows = _transposed(Q[:, 3:].reshape(by_pose.shape)[at])
        np.add.at(by_landmark, (step, model.slot[rows]), to_rows @ model.Hm[rows])
        X[part, :, -1:] = _sum_by(at[0], to_rows @ model.r[rows, :, None], scans)
    return G, X


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


def filter_covariances(model: LinearModel, G: Float) -> tuple[Float, Float, Float, Float, Float]:
    """Kalman filter of a pose given the landmarks.

    Returns:
        Predicted and updated covariances P (N+1, 3, 3), carry F (I - K G), gain F K, and whitener L^-1 of the
        innovations' covariance L L'.
    """
    P, updated, carry, gain, whitener = np.empty((5, len(G), 3, 3))
    run_covariances(model.start_cov, model.F, model.W, np.ascontiguousarray(G), P, updated, carry, gain, whitener)
    return P, updated, carry, gain, whitener


def filter_maps(model: LinearModel, X: Float, carry: Float, gain: Float) -> Float:
    """Predicted poses as affine maps A (N+1, 3, 2L+1) of (dm, 1)."""
    A = np.empty_like(X)
    A[0] = 0.0
    A[0, :, -1] = model.start
    np.matmul(-gain[:-1], X[:-1], out=A[1:])
    A[1:, :, -1] += model.c
    run_maps(carry, A)
    return A


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
