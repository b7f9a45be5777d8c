"""Errors of a path relative to a reference path, without alignment: by pose and by step.

Rows of the reference that are NaN give NaN.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.se2 import between, wrap


def pose_errors(reference: Float, poses: Float) -> Float:
    """Return additive errors (n, 3) of `poses` (n, 3) in the world frame, [m, m, rad], heading wrapped."""
    errors = poses - reference
    for rows in chunks(len(errors)):
        errors[rows, 2] = wrap(errors[rows, 2])
    return errors


def squared_distances(errors: Float) -> Float:
    """Return squared position errors (n,) [m^2] of additive errors (n, 3)."""
    return np.square(errors[:, :2]).sum(axis=1)


def distances(errors: Float) -> Float:
    """Return position errors (n,) [m] of additive errors (n, 3)."""
    return np.sqrt(squared_distances(errors))


def step_errors(reference: Float, poses: Float) -> Float:
    """Return translations (n-1,) [m] by which consecutive body-frame steps differ (evo's RPE at a delta of one)."""
    errors = np.empty(len(poses) - 1)
    for rows in chunks(len(errors)):
        after = slice(rows.start + 1, rows.stop + 1)
        motions = between(poses[rows], poses[after]) - between(reference[rows], reference[after])
        errors[rows] = np.linalg.norm(motions[:, :2], axis=1)
    return errors
