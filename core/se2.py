"""Planar poses, the group SE(2): composition, exponential, logarithm and their Jacobians.

A pose is ``(x, y, heading)`` in the world frame, metres and radians, heading in (-pi, pi]. An increment
``(dx, dy, dtheta)`` is in the body frame at the start of its step. A tangent vector ``(x, y, turn)`` is a constant
body-frame velocity; in unit time it makes the increment exp(tangent) = (V(turn) (x, y), turn).

The functions of the first part take numbers or arrays of equal shape; `slamgauge.formula_kernels` compiles the same
functions for kernels. Source: Sola, Deray and Atchuthan, arXiv 1812.01537, equations 153 to 164.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, chunks, select

# --- formulas for numbers and arrays --------------------------------------------------------------


def wrap_angle(angle: Any) -> Any:
    """Return the angle [rad] wrapped into (-pi, pi]; an angle already there is unchanged."""
    wrapped = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))
    wrapped = select((wrapped <= -np.pi) | (wrapped > np.pi), np.pi, wrapped)  # rounding at the seam
    return select((angle > -np.pi) & (angle <= np.pi), angle, wrapped)


def mean_cos_sin(turn: Any) -> tuple[Any, Any]:
    """Return cosine and sine c, s of V(turn) = [[c, -s], [s, c]], the mean of the rotations from 0 to `turn`.

    c = sin(turn) / turn and s = (1 - cos(turn)) / turn.
    """
    is_zero = turn == 0.0
    safe = select(is_zero, 1.0, turn)
    return select(is_zero, 1.0, np.sin(turn) / safe), 2.0 * np.sin(0.5 * turn) ** 2 / safe


def exp_xy(x: Any, y: Any, turn: Any) -> tuple[Any, Any]:
    """Return the translation V(turn) (x, y) of the exponential of (x, y, turn)."""
    c, s = mean_cos_sin(turn)
    return c * x - s * y, s * x + c * y


def log_xy(x: Any, y: Any, turn: Any) -> tuple[Any, Any]:
    """Return the translation V(turn)^-1 (x, y) of the logarithm of the increment (x, y, turn).

    V(turn)^-1 = [[h cot h, h], [-h, h cot h]] with h = turn / 2.
    """
    half = 0.5 * turn
    cotangent = half_cotangent(half)
    return cotangent * x + half * y, cotangent * y - half * x


def half_cotangent(half: Any) -> Any:
    """Return h cot h of half a turn."""
    closed = half / np.tan(select(half == 0.0, 1.0, half))
    return select(np.abs(half) < 1e-4, 1.0 - half * half / 3.0, closed)


def right_jacobian_entries(x: Any, y: Any, turn: Any) -> tuple[Any, Any, Any, Any]:
    """Return j00, j01, j02, j12 of the right Jacobian [[j00, j01, j02], [-j01, j00, j12], [0, 0, 1]] at a tangent."""
    c, s, a, b = jacobian_coefficients(turn)
    return c, s, a * x - b * y, b * x + a * y


def jacobian_coefficients(turn: Any) -> tuple[Any, Any, Any, Any]:
    """Return c and s of V(turn), and a = (turn - sin(turn)) / turn^2 and b = (1 - cos(turn)) / turn^2."""
    c, s = mean_cos_sin(turn)
    is_tiny = np.abs(turn) < 1e-9  # squares of far smaller turns are 0
    safe = select(is_tiny, 1.0, turn)
    series = turn / 6.0 - turn**3 / 120.0 + turn**5 / 5040.0
    a = select(np.abs(turn) < 1e-2, series, (turn - np.sin(turn)) / (safe * safe))
    return c, s, a, select(is_tiny, 0.5, s / safe)


# --- angles and poses as arrays -------------------------------------------------------------------


def wrap(angle: ArrayLike) -> Float:
    """Return angles [rad] wrapped into (-pi, pi]; an angle already there is unchanged."""
    return wrap_angle(np.asarray(angle, dtype=np.float64))


def rotation(heading: ArrayLike) -> Float:
    """Return rotation matrices (..., 2, 2) from the body frame at `heading` [rad] to the world frame."""
    turn = np.empty((*np.shape(heading), 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(heading)
    turn[..., 1, 0] = np.sin(heading)
    turn[..., 0, 1] = -turn[..., 1, 0]
    return turn


def pose_rotation(heading: ArrayLike) -> Float:
    """Return matrices blkdiag(R, 1) (..., 3, 3) that turn (dx, dy, dtheta) from the body to the world frame."""
    turn = np.zeros((*np.shape(heading), 3, 3))
    turn[..., :2, :2], turn[..., 2, 2] = rotation(heading), 1.0
    return turn


def compose(pose: ArrayLike, increment: ArrayLike) -> Float:
    """Return the poses (..., 3) [m, m, rad] reached from `pose` by the body-frame `increment` (..., 3)."""
    pose, increment = np.asarray(pose, dtype=np.float64), np.asarray(increment, dtype=np.float64)
    position = pose[..., :2] + np.einsum("...ij,...j->...i", rotation(pose[..., 2]), increment[..., :2])
    heading = wrap(pose[..., 2] + increment[..., 2])
    return np.concatenate([position, heading[..., None]], axis=-1)


def in_body(pose: Float, point: Float) -> Float:
    """Return points (..., 2) of the world in the body frames of poses (..., 3): where landmarks are seen from poses."""
    return np.einsum("...ji,...j->...i", rotation(pose[..., 2]), point - pose[..., :2])


def between(start: ArrayLike, end: ArrayLike) -> Float:
    """Return the body-frame increments (..., 3) [m, m, rad] from the poses `start` to the poses `end`."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    position = in_body(start, end[..., :2])
    return np.concatenate([position, wrap(end[..., 2] - start[..., 2])[..., None]], axis=-1)


def chain(start: ArrayLike, increments: ArrayLike) -> Float:
    """Return the poses (N+1, 3) [m, m, rad] of a path from `start` (3,) along body-frame `increments` (N, 3)."""
    start, increments = np.asarray(start, dtype=np.float64), np.asarray(increments, dtype=np.float64)
    headings = start[2] + np.concatenate([[0.0], np.cumsum(increments[:, 2])])
    poses = np.zeros((len(headings), 3))
    for rows in chunks(len(increments)):
        turned = np.einsum("nij,nj->ni", rotation(headings[:-1][rows]), increments[rows, :2])
        poses[1:][rows, :2] = turned
    np.cumsum(poses[:, :2], axis=0, out=poses[:, :2])
    poses[:, :2] += start[:2]
    for rows in chunks(len(poses)):
        poses[rows, 2] = wrap(headings[rows])
    return poses


def exp(tangent: ArrayLike) -> Float:
    """Return the increments (..., 3) that the tangent vectors (..., 3) make in unit time; turns are not wrapped."""
    x, y, turn = _columns(tangent)
    return np.stack([*exp_xy(x, y, turn), turn], axis=-1)


def log(increment: ArrayLike) -> Float:
    """Return the tangent vectors (..., 3) of increments (..., 3) whose turns are in (-2 pi, 2 pi)."""
    x, y, turn = _columns(increment)
    return np.stack([*log_xy(x, y, turn), turn], axis=-1)


def right_jacobian(tangent: ArrayLike) -> Float:
    """Return J (..., 3, 3) at tangents (..., 3): exp(tangent + d) = exp(tangent) exp(J d) to first order in d."""
    x, y, turn = _columns(tangent)
    j00, j01, j02, j12 = right_jacobian_entries(x, y, turn)
    jacobian = np.zeros((*turn.shape, 3, 3))
    jacobian[..., 0, 0] = jacobian[..., 1, 1] = j00
    jacobian[..., 0, 1], jacobian[..., 1, 0] = j01, -j01
    jacobian[..., 0, 2], jacobian[..., 1, 2], jacobian[..., 2, 2] = j02, j12, 1.0
    return jacobian


def _columns(vectors: ArrayLike) -> Float:
    """Return x, y and turn, each (...), of vectors (..., 3)."""
    return np.moveaxis(np.asarray(vectors, dtype=np.float64), -1, 0)
