"""Linear algebra of the numpy filters: dense covariances with 2 x 2 blocks of landmarks."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.rounding_limits import LEAST
from slamgauge.se2 import rotation


def kalman_step(
    cov: Float, cross: Float, innovation_cov: Float, innovation: Float, frames: int
) -> tuple[Float, Float, float]:
    """Return the correction (n,) by an innovation, the updated covariance (n, n) and the NIS.

    Args:
        cov: (n, n) covariance P before the update.
        cross: (m, n) covariance of innovation and state, H P in a linear model.
        innovation_cov: (m, m) S, positive definite.
        innovation: (m,).
        frames: number of poses at the start of the state; positions follow.

    Raises:
        LinAlgError: S is not positive definite, or an updated variance is only rounding.
    """
    root = np.linalg.cholesky(innovation_cov)
    whitened = solve_triangular(root, np.column_stack([cross, innovation]), lower=True, check_finite=False)
    gain, surprise = whitened[:, :-1].copy(), whitened[:, -1]
    before, taken = (_by_place(each, frames) for each in (np.diagonal(cov), (gain**2).sum(axis=0)))
    if ((taken > 0.0) & ~(before - taken > LEAST * before)).any():
        raise np.linalg.LinAlgError("exhausted")
    return surprise @ gain, cov - gain.T @ gain, float(surprise @ surprise)


def _by_place(variances: Float, frames: int) -> Float:
    """Return the variances of headings, and the sums of both variances of positions, of which one may be zero."""
    poses, places = variances[: 3 * frames].reshape(-1, 3), variances[3 * frames :].reshape(-1, 2)
    return np.concatenate([poses[:, 2], poses[:, :2].sum(axis=1), places.sum(axis=1)])


def place_jacobian(heading: float, offset: Float) -> Float:
    """Return the Jacobians (s, 2, 5) of positions in the robot's frame, R(heading)' (l - p).

    The columns are the derivatives by robot x, y, heading and position x, y.

    Args:
        heading: heading of the robot [rad].
        offset: (s, 2) positions in the robot's frame [m].
    """
    back = rotation(heading).T
    jacobian = np.empty((len(offset), 2, 5))
    jacobian[:, :, :2], jacobian[:, :, 3:] = -back, back
    jacobian[:, 0, 2], jacobian[:, 1, 2] = offset[:, 1], -offset[:, 0]
    return jacobian


def times_rows(jacobian: Float, robot: Float, places: Float) -> Float:
    """Return products (2s, k) of Jacobians (s, 2, 5) with rows of the robot (3, k) and of the positions (2s, k)."""
    of_places = jacobian[:, :, 3:] @ places.reshape(-1, 2, places.shape[1])
    return (jacobian[:, :, :3] @ robot + of_places).reshape(places.shape)


def pairs(slots: Int, first: int) -> Int:
    """Return both entries (2s,) of each slot (s,); slot 0 begins at entry `first`."""
    return (first + 2 * slots[:, None] + [0, 1]).ravel()


def block_diagonal(blocks: Float) -> Float:
    """Return the block-diagonal matrix (2m, 2m) of blocks (m, 2, 2)."""
    count = len(blocks)
    whole = np.zeros((count, 2, count, 2))
    whole[np.arange(count), :, np.arange(count)] = blocks
    return whole.reshape(2 * count, 2 * count)


def symmetric(matrices: Float) -> Float:
    """Return the symmetric part of matrices (..., n, n) that are symmetric up to rounding."""
    return (matrices + matrices.swapaxes(-1, -2)) / 2
