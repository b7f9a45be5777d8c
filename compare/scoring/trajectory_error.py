"""Errors of a path against a reference path, pose by pose; rows of NaN in the reference stay NaN."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, chunks
from slamgauge.se2 import between, rotation, wrap


def pose_errors(reference: Float, poses: Float) -> Float:
    """Additive errors (n, 3) of `poses` (n, 3) in the world frame, [m, m, rad], heading wrapped."""
    errors = poses - reference
    for rows in chunks(len(errors)):
        errors[rows, 2] = wrap(errors[rows, 2])
    return errors


def squared_distances(errors: Float) -> Float:
    """Squared position errors (n,) [m^2] of additive errors (n, 3)."""
    return np.square(errors[:, :2]).sum(axis=1)


def distances(errors: Float) -> Float:
    """Position errors (n,) [m] of additive errors (n, 3)."""
    return np.sqrt(squared_distances(errors))


def stored_distances(errors_x: Float, errors_y: Float) -> Float:
    """The same of errors by coordinate (n,), to the last bit as stores of earlier versions hold them."""
    return np.hypot(errors_x, errors_y)


def step_errors(reference: Float, poses: Float) -> Float:
    """Translations (n-1,) [m] by which consecutive body-frame steps differ (evo's RPE at a delta of one)."""
    errors = np.empty(len(poses) - 1)
    for rows in chunks(len(errors)):
        ends = slice(rows.start + 1, rows.stop + 1)
        steps = between(poses[rows], poses[ends]) - between(reference[rows], reference[ends])
        errors[rows] = np.linalg.norm(steps[:, :2], axis=1)
    return errors


def aligned_errors(positions: Float, reference: Float) -> Float:
    """Return the differences (n, 2) [m] of `positions` from `reference` after alignment; NaN in gaps of the reference.

    The alignment is a rigid motion in SE(2), without scale and reflection, with the least sum of squares where the
    reference is defined; a path without extent is translated only (Horn 1987, the planar case in closed form). All
    positions are relative to the first reference, since far from the world's origin doubles have fewer digits.
    """
    known = np.asarray(np.isfinite(reference).all(axis=1))
    if not known.any():
        return np.full(positions.shape, np.nan)
    return _aligned(positions, reference, known) - (reference - reference[known][0])


def _aligned(positions: Float, reference: Float, known: NDArray[np.bool_]) -> Float:
    """`positions` (n, 2) aligned to the `known` rows of `reference`, relative to the first of these."""
    first, rows = known.argmax(), slice(None) if known.all() else known  # a slice needs no copies
    positions, goal = positions - positions[first], reference[rows] - reference[first]
    center, target = positions[rows].mean(axis=0), goal.mean(axis=0)
    source = positions[rows] - center
    goal -= target
    sine = np.sum(source[:, 0] * goal[:, 1] - source[:, 1] * goal[:, 0])
    return (positions - center) @ rotation(np.arctan2(sine, np.sum(source * goal))).T + target
