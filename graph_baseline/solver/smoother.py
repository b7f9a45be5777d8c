"""Solution of the linearised graph by its Schur complement: the step and all covariances.

Given the landmarks m, the poses are a Markov chain, and each pose is an affine function of m. A forward pass (a Kalman
filter whose mean is the 3 x (2L + 1) matrix of this affine map) computes the landmarks' information Lambda, the Schur
complement of the poses. A backward pass (modified Bryson-Frazier, which inverts no covariance) smooths the chain. Then
cov(m) = Lambda^-1 and cov(x_k) = P_k + A_k Lambda^-1 A_k'. Singular motion noise and a fixed start are exact, because
no pose covariance is inverted.

Cost: O(N L^2) in two symmetric products, and recursions of 3 x 3 matrices; no matrix is larger than (3N, 2L).
Source: Bierman, "Factorization methods for discrete sequential estimation" (1977), chapter X.

A long path through a large map is cut into pieces (`chain_partition`) with few landmarks each. The poses at the cuts
are then unknowns, like the landmarks. The last pose of a piece is treated as a noise-free observation of the unknown.
Lambda is sparse and is factorised by `multifrontal`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import get_blas_funcs, solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import LinearModel, linearise
from slamgauge.graph_baseline.problem.preparation import Problem, least_known_landmark
from slamgauge.graph_baseline.problem.undetermined import undetermined_variable
from slamgauge.graph_baseline.solver.chain_partition import Piece, plan
from slamgauge.graph_baseline.solver.motion_elimination import Chain, eliminate_motions, shear
from slamgauge.graph_baseline.solver.multifrontal import Factor, covariance_roots, factorise, minimise
from slamgauge.graph_baseline.solver.recursions import run_adjoints
from slamgauge.graph_baseline.solver.reduced_scans import (
    NOT_DAMPED,
    Damping,
    chunks,
    compressed_scans,
    filter_covariances,
    filter_maps,
    gram,
    landmarks_alone,
    own_information,
    subtract_scans,
    transposed,
)
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once

(multiply_triangular,) = get_blas_funcs(("trmm",), dtype=np.float64)


class Solution(NamedTuple):
    """Gauss-Newton step and covariances of the linearised problem, additive, in the world frame."""

    dx: Float  # (N+1, 3)
    dm: Float  # (L, 2)
    pose_covs: Float  # (N+1, 3, 3)
    landmark_covs: Float  # (L, 2, 2)


class KeyMaps(NamedTuple):
    """The key poses of a piece as affine maps of (u, 1); u are its n unknowns."""

    A: Float  # (K, 3, n+1) predicted maps
    P: Float  # (K, 3, 3) predicted covariances, given the unknowns
    updated: Float  # (K, 3, 3) covariances after the scan of the key
    adjoint: Float  # (K, 3, n+1) smoothed A is A - P adjoint
    adjoint_cov: Float  # (K, 3, 3) smoothed P is P - P adjoint_cov P


class Eliminated(NamedTuple):
    """All pieces, and their joint information about the unknowns."""

    pieces: list[Piece]
    keys: list[KeyMaps]
    factor: Factor
    unknowns: Float  # (n+1,) at the minimum: landmarks (L, 2), poses at cuts (J, 3), and the constant 1


def solve_at(recording: Problem, poses: Float, landmarks: Float) -> Solution:
    """Solve the exact model linearised at `poses` (N+1, 3) and `landmarks` (L, 2), ids increasing.

    Raises:
        UndeterminedError: the observations do not determine the landmarks.
    """
    try:
        return solve(linearise(recording, recording.slot, poses, landmarks), len(landmarks))
    except np.linalg.LinAlgError:
        raise undetermined_variable("l", least_known_landmark(recording)[0]) from None


def solve(model: LinearModel, landmarks: int) -> Solution:
    """Minimise the linear model over all poses and `landmarks` landmarks.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """
    eliminated = _eliminate(eliminate_motions(model), landmarks, NOT_DAMPED)
    pose_covs, landmark_covs = np.empty((len(model.F) + 1, 3, 3)), np.empty((landmarks, 2, 2))
    for number, place, root in covariance_roots(eliminated.factor, np.zeros((0, 0))):
        piece, order = eliminated.pieces[number], np.argsort(place)
        landmark_covs[piece.slots] = _own_blocks(root[place[: 2 * len(piece.slots)]])
        for poses, A, P in _smoothed_maps(piece.chain, eliminated.keys[number]):
            maps = A[:, :, order].reshape(3 * len(A), len(order))
            spread = multiply_triangular(1.0, root.T, maps.T, lower=1, overwrite_b=1).T.reshape(A[:, :, :-1].shape)
            pose_covs[poses] = P + spread @ transposed(spread)
    return Solution(*_newton_step(eliminated, len(pose_covs), landmarks), pose_covs, landmark_covs)


def damped_step(model: LinearModel, landmarks: int, damping: Damping) -> tuple[Float, Float]:
    """Return the damped step (N+1, 3), (L, 2); errors as in `solve`.

    Up to a constant, |w + dw|^2 + d |dw|^2 is (1 + d) |dw + w / (1 + d)|^2: damping d of a motion reduces its noise.
    """
    share = 1.0 / (1.0 + damping.motion)
    chain = eliminate_motions(
        model._replace(
            start=share * model.start, start_cov=share * model.start_cov, c=share * model.c, W=share * model.W
        )
    )
    return _newton_step(_eliminate(chain, landmarks, damping), len(model.F) + 1, landmarks)


def _eliminate(chain: Chain, landmarks: int, damping: Damping) -> Eliminated:
    compile_graphs_once()
    planned = plan(chain, landmarks)
    damping_of, own_information_of, unknowns = (
        np.zeros(planned.unknowns),
        np.zeros(planned.unknowns),
        np.zeros(planned.unknowns + 1),
    )
    damping_of[: 2 * landmarks] = damping.landmark
    own_information_of[: 2 * landmarks] = damping_of[: 2 * landmarks] + own_information(chain.model, landmarks)
    keys: dict[int, KeyMaps] = {}

    def information_of(number: int) -> Float:
        keys[number], information = _poses_eliminated(planned.pieces[number], damping)
        return information

    factor, _ = factorise(planned.front, information_of, damping_of, own_information_of)
    unknowns[-1] = 1.0
    minimise(factor, unknowns)
    return Eliminated(planned.pieces, [keys[number] for number in range(len(keys))], factor, unknowns)


def _poses_eliminated(piece: Piece, damping: Damping) -> tuple[KeyMaps, Float]:
    """Eliminate the poses of a piece; return their maps, and the information (n+1, n+1) about unknowns and constant."""
    model, width = piece.chain.model, 2 * len(piece.slots)
    first, last = slice(width, width + 3 * piece.begins), slice(len(piece.columns) - 3 * piece.ends, -1)
    G, X = compressed_scans(model, len(piece.slots), damping, len(piece.columns))
    joint = landmarks_alone(model, len(piece.slots), len(piece.columns))
    subtract_scans(joint, X, model)
    if piece.ends:  # the last pose equals an unknown
        G[-1], X[-1, :, last] = np.eye(3), -np.eye(3)
    P, updated, carry, gain, whitener = filter_covariances(model, G)
    if piece.ends:
        updated[-1] = 0.0
        whitener[-1] = solve_triangular(np.linalg.cholesky(P[-1]), np.eye(3), lower=True, check_finite=False)
    start = np.zeros((3, len(joint)))
    start[:, first] = np.eye(3)[:, : 3 * piece.begins]
    start[:, -1] = model.start
    A = filter_maps(start, model.c, X, carry, gain)
    observed = whitener @ G
    for steps in chunks(len(A)):
        innovation = whitener[steps] @ (G[steps] @ A[steps] + X[steps])
        joint += gram(innovation)
        X[steps] = transposed(observed[steps]) @ innovation
    adjoint_cov = transposed(observed) @ observed
    run_adjoints(carry, X, adjoint_cov)
    return KeyMaps(A, P, updated, X, adjoint_cov), joint


def _newton_step(eliminated: Eliminated, poses: int, landmarks: int) -> tuple[Float, Float]:
    """Return the step of all poses (N+1, 3) and landmarks (L, 2)."""
    dx = np.empty((poses, 3))
    for piece, keys in zip(eliminated.pieces, eliminated.keys, strict=True):
        _move_poses(piece.chain, keys, eliminated.unknowns[np.append(piece.columns, -1)], dx)
    return dx, eliminated.unknowns[: 2 * landmarks].reshape(-1, 2)


def _move_poses(chain: Chain, keys: KeyMaps, at: Float, dx: Float) -> None:
    """Fill `dx` (N+1, 3) for the poses of a piece, with (u, 1) = `at`."""
    predicted, adjoint = keys.A @ at, keys.adjoint @ at
    dx[chain.key] = predicted - np.einsum("kij,kj->ki", keys.P, adjoint)
    between = chain.between
    if len(between.pose):
        before, P = between.key - 1, _predicted_between(chain, keys, slice(None))
        start = predicted[between.key] - chain.model.c[before]
        start[:, :2] -= between.lever_to * start[:, 2:]
        rhs = adjoint[between.key]
        rhs[:, 2] += (between.lever_to * rhs[:, :2]).sum(axis=1)
        dx[between.pose] = start + between.c - np.einsum("kij,kj->ki", P, rhs)


def _smoothed_maps(chain: Chain, keys: KeyMaps) -> Iterator[tuple[Int, Float, Float]]:
    """Yield poses (n,) in chunks, with smoothed maps (n, 3, n_u+1) and covariances (n, 3, 3) given the unknowns."""
    for part in chunks(len(chain.key)):
        P, adjoint = keys.P[part], keys.adjoint[part]
        later = _carried_back(chain.model.F, keys.adjoint_cov, part)
        yield chain.key[part], keys.A[part] - P @ adjoint, _smoothed_covariances(keys.updated[part], later)
    between = chain.between
    for part in chunks(len(between.pose)):
        key, lever = between.key[part], between.lever_to[part]
        P = _predicted_between(chain, keys, part)
        A = keys.A[key]
        A[:, :, -1] -= chain.model.c[key - 1]
        A[:, :2] -= lever[:, :, None] * A[:, 2:]
        A[:, :, -1] += between.c[part]
        adjoint = keys.adjoint[key]
        adjoint[:, 2] += np.einsum("ki,kij->kj", lever, adjoint[:, :2])
        adjoint_cov = keys.adjoint_cov[key]
        adjoint_cov[:, 2, :] += np.einsum("ki,kij->kj", lever, adjoint_cov[:, :2, :])
        adjoint_cov[:, :, 2] += np.einsum("ki,kji->kj", lever, adjoint_cov[:, :, :2])
        yield between.pose[part], A - P @ adjoint, _smoothed_covariances(P, adjoint_cov)


def _carried_back(F: Float, adjoint_cov: Float, part: slice) -> Float:
    """Return the information (n, 3, 3) of later scans about each pose."""
    back = np.zeros_like(adjoint_cov[part])
    move = F[part]
    back[: len(move)] = transposed(move) @ adjoint_cov[part.start + 1 : part.start + 1 + len(move)] @ move
    return back


def _smoothed_covariances(P: Float, adjoint_cov: Float) -> Float:
    smoothed = P - P @ adjoint_cov @ P
    return (smoothed + transposed(smoothed)) / 2


def _predicted_between(chain: Chain, keys: KeyMaps, part: slice) -> Float:
    """Return covariances (n, 3, 3) of poses between keys, predicted from the previous key."""
    between = chain.between
    P = keys.updated[between.key[part] - 1]
    shear(P, between.lever_from[part])
    return P + between.W[part]


def own_blocks_of_inverse(factor: Float) -> Float:
    """Return the diagonal blocks (L, 2, 2) of (factor factor')^-1."""
    return _own_blocks(solve_triangular(factor, np.eye(len(factor)), trans=1, lower=True, check_finite=False))


def _own_blocks(root: Float) -> Float:
    """Return the diagonal blocks (l, 2, 2) of the covariance RR' with root R (2l, n)."""
    x, y = root[0::2], root[1::2]
    xx, xy, yy = ((one * other).sum(axis=1) for one, other in ((x, x), (x, y), (y, y)))
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
