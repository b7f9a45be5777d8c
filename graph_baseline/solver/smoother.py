"""Solution of a linearised graph by its Schur complement: the step and all covariances.

The poses are eliminated (`elimination`), and the remaining information about the landmarks is factorised. Then
cov(landmarks) is its inverse, and cov(pose) = V + A cov(landmarks) A' with the smoothed map A and covariance V of the
pose given the landmarks.

Cost: O(N L^2) in two products with matrices of (3N, 2L), and recursions of 3 x 3 matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_solve, get_blas_funcs, solve_triangular

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.solver.elimination import (
    Chain,
    eliminate_poses,
    empty_chain,
    empty_frontier,
    run_adjoints,
    smooth_covariances,
)
from slamgauge.graph_baseline.solver.sparse_system import SparseSystem
from slamgauge.memory import require_memory

(multiply_triangular,) = get_blas_funcs(("trmm",), dtype=np.float64)

LARGEST_DENSE = 500  # landmarks; smaller maps take at most a second
SPARSE_COST = 200.0  # time of the sparse covariances / (poses x observations), relative to that of dense / landmarks^3
POSES_TOGETHER = 128  # poses that are processed together; their rows take a few megabytes
EXACT = 1e-9  # m or rad; a smaller standard deviation is treated as zero
LOST_PIVOT = 1e-12  # a pivot below this share of a landmark's information is rounding
SPARSE = ("gtsam-batch", "isam2")  # estimators that eliminate variables in the order of least memory
MAPS, MATRICES = 6.0, 6.0  # largest number of arrays (N+1, 3, 2L) and (2L, 2L) in memory at the same time


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
    """A linear model after the elimination of its poses."""

    model: LinearModel
    chain: Chain
    maps: Float  # (N+1, 3, 2L+1) predicted poses as affine maps of (1, landmarks)
    rows: Float  # (N+1, 3, 2L+1) whitened innovations of the scans, as affine maps
    root: Float  # (2L, 2L) lower triangular factor of the landmarks' information
    at: Float  # (2L+1,) the constant 1, and the landmarks at the minimum


def damped_step(model: LinearModel, scans: Scans, landmarks: int, damping: Damping) -> tuple[Float, Float]:
    """Return the damped step of poses (N+1, 3) and landmarks (L, 2).

    Up to a constant, |w + dw|^2 + d |dw|^2 is (1 + d) |dw + w / (1 + d)|^2: damping d of a motion reduces its noise.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """
    share = 1.0 / (1.0 + damping.motion)
    damped = model._replace(c=share * model.c, W=share * model.W)
    if is_sparse(len(model.c), len(model.r), landmarks):
        return SparseSystem(damped, scans, landmarks, damping.pose, damping.landmark).step()
    return _step(_without_poses(damped, scans, landmarks, damping))


def solve(model: LinearModel, scans: Scans, landmarks: int) -> Solution:
    """Minimise the linear model over all poses and landmarks; errors as in `damped_step`."""
    if is_sparse(len(model.c), len(model.r), landmarks):
        sparse = SparseSystem(model, scans, landmarks, NOT_DAMPED.pose, NOT_DAMPED.landmark)
        return Solution(*sparse.step(), *sparse.covariances())
    system = _without_poses(model, scans, landmarks, NOT_DAMPED)
    step = _step(system)
    root = solve_triangular(system.root, np.eye(2 * landmarks), trans=1, lower=True, check_finite=False)
    return Solution(*step, _pose_covs(system, root), own_blocks(root))


def _without_poses(model: LinearModel, scans: Scans, landmarks: int, damping: Damping) -> Eliminated:
    poses, size = len(model.c), 2 * landmarks + 1
    chain, front = empty_chain(poses), empty_frontier(size - 1)
    maps, rows = np.empty((2, poses, 3, size))
    eliminate_poses(scans, model, damping.pose, chain, front, (0, poses), maps, rows)
    stacked = rows.reshape(-1, size)
    information = np.tril(front.information) + np.tril(front.information, -1).T + stacked.T @ stacked
    information[np.arange(1, size), np.arange(1, size)] += damping.landmark
    root = np.asarray(np.linalg.cholesky(information[1:, 1:]), dtype=np.float64)
    squares = np.square(model.Hm).sum(axis=1)
    own = np.column_stack([np.bincount(scans.slot, each, landmarks) for each in squares.T]).ravel() + damping.landmark
    if (np.square(np.diag(root)) < LOST_PIVOT * own).any():
        raise LinAlgError("the remaining information of a landmark is rounding")
    at = np.append(1.0, -cho_solve((root, True), information[1:, 0], check_finite=False))
    return Eliminated(model, chain, maps, rows, root, at)


def _step(system: Eliminated) -> tuple[Float, Float]:
    """Return the step of all poses (N+1, 3) and landmarks (L, 2)."""
    adjoints = (system.rows @ system.at)[:, :, None]
    run_adjoints(system.model, system.chain, adjoints)
    return system.maps @ system.at - (system.chain.P @ adjoints)[:, :, 0], system.at[1:].reshape(-1, 2)


def _pose_covs(system: Eliminated, root: Float) -> Float:
    """Return covariances (N+1, 3, 3) of the poses; `root` (2L, 2L) is that of the landmarks' covariance."""
    model, chain, maps, adjoints = system[:4]
    run_adjoints(model, chain, adjoints)
    covs = np.empty((len(maps), 3, 3))
    smooth_covariances(model, chain, covs)
    for first in range(0, len(maps), POSES_TOGETHER):
        part = slice(first, first + POSES_TOGETHER)
        A = (maps[part] - chain.P[part] @ adjoints[part])[:, :, 1:].reshape(3 * len(maps[part]), len(root))
        spread = multiply_triangular(1.0, root.T, A.T, lower=1, overwrite_b=1).T.reshape(len(maps[part]), 3, len(root))
        covs[part] += spread @ spread.swapaxes(1, 2)
    return covs


def own_blocks(root: Float) -> Float:
    """Return the diagonal blocks (l, 2, 2) of the covariance RR' with root R (2l, n)."""
    x, y = root[0::2], root[1::2]
    xx, xy, yy = ((one * other).sum(axis=1) for one, other in ((x, x), (x, y), (y, y)))
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def is_sparse(poses: int, observations: int, landmarks: int) -> bool:
    """Return whether `SparseSystem` solves the problem: the map is large, and few poses observe the same landmarks."""
    return landmarks > LARGEST_DENSE and SPARSE_COST * poses * observations < float(landmarks) ** 3


def require_memory_for(problem: Problem, name: str) -> None:
    """Require enough free memory for the dense matrices of all poses and landmarks, unless an estimator has none.

    Raises:
        UserError: there is not enough memory for the estimator `name`.
    """
    landmarks, poses = len(problem.landmark_ids), problem.steps + 1
    if name in SPARSE or (name.endswith("batch") and is_sparse(poses, len(problem.slot), landmarks)):
        return
    needed = 8.0 * (MAPS * 3 * poses * 2 * landmarks + MATRICES * (2 * landmarks) ** 2)
    what = f"{name} of {landmarks} landmarks in {poses} poses"
    require_memory(needed, what, "use gtsam-batch or isam2, whose matrices are sparse, or give a part of the recording")
