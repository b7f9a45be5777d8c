"""Planar poses: composition, increments, angles.

A pose is ``(x, y, heading)`` in the world frame, metres and radians, heading in (-pi, pi]. An increment
``(dx, dy, dtheta)`` is expressed in the body frame at the start of its step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, chunks


def wrap(angle: ArrayLike) -> Float:
    """Angle(s) in rad brought into (-pi, pi]; an angle already there is returned unchanged."""
    angle = np.asarray(angle, dtype=np.float64)
    wrapped = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))
    wrapped = np.where((wrapped <= -np.pi) | (wrapped > np.pi), np.pi, wrapped)  # rounding at the seam
    return np.where((angle > -np.pi) & (angle <= np.pi), angle, wrapped)


def rotation(heading: ArrayLike) -> Float:
    """Rotation matrices (..., 2, 2) that take body-frame vectors at `heading` [rad] to the world."""
    turn = np.empty((*np.shape(heading), 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(heading)
    turn[..., 1, 0] = np.sin(heading)
    turn[..., 0, 1] = -turn[..., 1, 0]
    return turn


def compose(pose: ArrayLike, increment: ArrayLike) -> Float:
    """Poses (..., 3) reached from `pose` by the body-frame `increment` (..., 3)."""
    pose, increment = np.asarray(pose, dtype=np.float64), np.asarray(increment, dtype=np.float64)
    position = pose[..., :2] + np.einsum("...ij,...j->...i", rotation(pose[..., 2]), increment[..., :2])
    heading = wrap(pose[..., 2] + increment[..., 2])
    return np.concatenate([position, heading[..., None]], axis=-1)


def between(start: ArrayLike, end: ArrayLike) -> Float:
    """Body-frame increments (..., 3) that lead from the poses `start` to the poses `end`."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    displacement = end[..., :2] - start[..., :2]
    position = np.einsum("...ji,...j->...i", rotation(start[..., 2]), displacement)
    return np.concatenate([position, wrap(end[..., 2] - start[..., 2])[..., None]], axis=-1)


def chain(start: ArrayLike, increments: ArrayLike) -> Float:
    """Poses (N+1, 3) of a path from `start` (3,) along body-frame `increments` (N, 3)."""
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
