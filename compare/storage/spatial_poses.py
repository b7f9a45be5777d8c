"""Planar parts of poses in space, with heading as the rotation about z."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float

PLANAR = (0, 1, 5)  # rows of x, y and heading in a covariance (6, 6) of ROS


def rotations(quaternions: Float) -> Float:
    """Return matrices (n, 3, 3) of quaternions (n, 4) in x, y, z, w of any length; zeros are the identity."""
    unset = ~quaternions.any(axis=1, keepdims=True)
    x, y, z, w = np.where(unset, [0.0, 0.0, 0.0, 1.0], quaternions).T
    rows = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), w * w - x * x + y * y - z * z, 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows) / (w * w + x * x + y * y + z * z), 2, 0)


def planar_poses(poses: Float) -> Float:
    """Return x, y and heading (n, 3) of poses (n, 7): position, then quaternion in x, y, z, w."""
    turned = rotations(poses[:, 3:])
    return np.column_stack([poses[:, :2], np.arctan2(turned[:, 1, 0], turned[:, 0, 0])])


def planar_covariances(covs: Float) -> Float:
    """Return covariances (n, 3, 3) of x, y, heading from those, (n, 6, 6) or (n, 36), of x, y, z, roll, pitch, yaw."""
    return covs.reshape(-1, 6, 6)[:, PLANAR][:, :, PLANAR]
