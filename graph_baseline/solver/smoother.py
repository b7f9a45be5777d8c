"""Solution of a linearised graph by its Schur complement: the step and all covariances.

Poses are eliminated piece by piece (`elimination`); usually the whole path is one piece. The remaining information
about the landmarks, and about poses at cuts of a long path, is factorised (`multifrontal`). Then cov(landmarks) is its
inverse, and cov(pose) = V + A cov(landmarks) A' with the smoothed map A and covariance V of the pose given the
landmarks. In a piece, an unknown last pose is treated as a noise-free observation of that pose.

Cost: O(N L^2) in two products with matrices of (3N, 2L), and recursions of 3 x 3 matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import get_blas_funcs, solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.solver.elimination import (
    Chain,
    Scans,
    eliminate_poses,
    empty_chain,
    empty_frontier,
    run_adjoints,
    smooth_covariances,
)
from slamgauge.graph_baseline.solver.multifrontal import Factor, covariance_roots, factorise, minimise
from slamgauge.graph_baseline.solver.partition import Piece, Plan

(multiply_triangular,) = get_blas_funcs(("trmm",), dtype=np.float64)

POSES_TOGETHER = 128  # poses that are processed together; their rows take a few megabytes
EXACT = 1e-9  # m or rad; a smaller standard deviation is treated as zero


class Damping(NamedTuple):
    """Levenberg-Marquardt damping: information added to poses with scans, landmarks and motions."""

    pose: Float  # (3,) [1/m^2, 1/m^2, 1/rad^2]
    landmark: float  # [1/m^2]
    motion: float  # relative to the information of start and motions


NOT_DAMPED = Damping(np.zeros(3), 0.0, 0.0)


class Solution(NamedTuple):
    """Gauss-Newton step and covariances of the linearised problem, additive, in the world frame."""

    dx: Float  # (N+1, 3)
    dm: Float  # (L, 2)
    pose_covs: Float  # (N+1, 3, 3)
    landmark_covs: Float  # (L, 2, 2)


class Eliminated(NamedTuple):
    """A piece with n unknowns u after the elimination of its K poses."""

    model: LinearModel
    chain: Chain
    maps: Float  # (K, 3, n+1) predicted poses as affine maps of (1, u)
    rows: Float  # (K, 3, n+1) whitened innovations of the scans, as affine maps


class System(NamedTuple):
    """All pieces, and their joint information about the unknowns."""

    pieces: list[Eliminated]
    factor: Factor
    unknowns: Float  # (n+1,) at the minimum: landmarks (L, 2), poses at cuts (J, 3), and the constant 1


def damped_step(model: LinearModel, scans: Scans, planned: Plan, damping: Damping) -> tuple[Float, Float]:
    """Return the damped step of poses (N+1, 3) and landmarks (L, 2).

    Up to a constant, |w + dw|^2 + d |dw|^2 is (1 + d) |dw + w / (1 + d)|^2: damping d of a motion reduces its noise.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """
    share = 1.0 / (1.0 + damping.motion)
    return _step(_eliminated(model._replace(c=share * model.c, W=share * model.W), scans, planned, damping), planned)


def solve(model: LinearModel, scans: Scans, planned: Plan) -> Solution:
    """Minimise the linear model over all poses and landmarks; errors as in `damped_step`."""
    system = _eliminated(model, scans, planned, NOT_DAMPED)
    step = _step(system, planned)
    pose_covs, landmark_covs = np.empty((len(model.c), 3, 3)), np.empty((len(step[1]), 2, 2))
    for number, place, root in covariance_roots(system.factor, np.zeros((0, 0))):
        piece, order = planned.pieces[number], np.argsort(place)
        landmark_covs[piece.slots] = own_blocks(root[place[: 2 * len(piece.slots)]])
        pose_covs[piece.poses] = _pose_covs(system.pieces[number], order, root)
    return Solution(*step, pose_covs, landmark_covs)


def _eliminated(model: LinearModel, scans: Scans, planned: Plan, damping: Damping) -> System:
    landmarks = planned.landmarks
    damping_of, own = np.zeros(planned.unknowns), np.zeros(planned.unknowns)
    damping_of[: 2 * landmarks] = damping.landmark
    squares = np.square(model.Hm).sum(axis=1)
    own[: 2 * landmarks] = np.column_stack([np.bincount(scans.slot, each, landmarks) for each in squares.T]).ravel()
    pieces: dict[int, Eliminated] = {}

    def information_of(number: int) -> Float:
        pieces[number], information = _without_poses(model, scans, planned.pieces[number], damping.pose)
        return information

    factor, _ = factorise(planned.front, information_of, damping_of, own + damping_of)
    unknowns = np.append(np.zeros(planned.unknowns), 1.0)
    minimise(factor, unknowns)
    return System([pieces[number] for number in range(len(pieces))], factor, unknowns)


def _without_poses(model: LinearModel, scans: Scans, piece: Piece, damping: Float) -> tuple[Eliminated, Float]:
    """Eliminate the poses of a piece; return it, and the information (n+1, n+1) about unknowns and the constant."""
    poses, rows = piece.poses, piece.rows
    part = LinearModel(*(each[poses] for each in model[:3]), *(each[rows] for each in model[3:]))
    first = np.minimum(scans.first[poses.start : poses.stop + 1], rows.stop) - rows.start
    size, count = len(piece.columns) + 1, len(part.c)
    front, chain = empty_frontier(size - 1), empty_chain(count)
    if piece.begins:  # the motion to the first pose belongs to the piece before
        part = part._replace(lever=part.lever.copy(), c=part.c.copy(), W=part.W.copy())
        part.lever[0], part.c[0], part.W[0] = 0.0, 0.0, 0.0
        begin = 1 + 2 * len(piece.slots)
        front.M[:, begin : begin + 3] = np.eye(3)
    maps, innovations = np.empty((2, count, 3, size))
    local = Scans(first, np.searchsorted(piece.slots, scans.slot[rows]))
    eliminate_poses(local, part, damping, chain, front, (0, count), maps, innovations)
    if piece.ends:  # the last pose equals an unknown
        chain.T[-1] = solve_triangular(np.linalg.cholesky(chain.P[-1]), np.eye(3), lower=True, check_finite=False)
        innovations[-1] = chain.T[-1] @ maps[-1]
        innovations[-1, :, -3:] -= chain.T[-1]
    information = np.tril(front.information) + np.tril(front.information, -1).T
    stacked = innovations.reshape(-1, size)
    information += stacked.T @ stacked
    return Eliminated(part, chain, maps, innovations), np.roll(information, (-1, -1), axis=(0, 1))


def _step(system: System, planned: Plan) -> tuple[Float, Float]:
    """Return the step of all poses (N+1, 3) and landmarks (L, 2)."""
    dx = np.empty((planned.pieces[-1].poses.stop, 3))
    for piece, (model, chain, maps, rows) in zip(planned.pieces, system.pieces, strict=True):
        at = system.unknowns[np.append(-1, piece.columns)]
        adjoints = (rows @ at)[:, :, None]
        run_adjoints(model, chain, adjoints)
        dx[piece.poses] = maps @ at - (chain.P @ adjoints)[:, :, 0]
    return dx, system.unknowns[: 2 * planned.landmarks].reshape(-1, 2)


def _pose_covs(piece: Eliminated, order: Int, root: Float) -> Float:
    """Return covariances (K, 3, 3) of the poses of a piece; `root` is that of its unknowns in the given order (n,)."""
    model, chain, maps, adjoints = piece
    run_adjoints(model, chain, adjoints)
    covs = np.empty((len(maps), 3, 3))
    smooth_covariances(model, chain, covs)
    for first in range(0, len(maps), POSES_TOGETHER):
        part = slice(first, first + POSES_TOGETHER)
        A = (maps[part] - chain.P[part] @ adjoints[part])[:, :, 1 + order].reshape(3 * len(maps[part]), len(order))
        spread = multiply_triangular(1.0, root.T, A.T, lower=1, overwrite_b=1).T.reshape(len(maps[part]), 3, len(order))
        covs[part] += spread @ spread.swapaxes(1, 2)
    return covs


def own_blocks(root: Float) -> Float:
    """Return the diagonal blocks (l, 2, 2) of the covariance RR' with root R (2l, n)."""
    x, y = root[0::2], root[1::2]
    xx, xy, yy = ((one * other).sum(axis=1) for one, other in ((x, x), (x, y), (y, y)))
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
