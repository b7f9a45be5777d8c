"""Errors of a path relative to a reference path, without alignment: by pose, by step, by distance.

Rows of the reference that are NaN give NaN.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int, chunks
from slamgauge.compare.scoring.nan_stats import rms
from slamgauge.se2 import between, wrap

LENGTHS = (1.0, 2.0, 5.0)  # lengths of segments, times powers of ten [m]
LONGEST_SEGMENT = 0.5  # longest segment, as a share of the true path: at least half of the poses begin one


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
        motions = _motion_errors(reference, poses, rows, slice(rows.start + 1, rows.stop + 1))
        errors[rows] = np.linalg.norm(motions[:, :2], axis=1)
    return errors


def _motion_errors(reference: Float, poses: Float, begin: slice, end: slice | Int) -> Float:
    """Return the errors (n, 3) of the motions from poses `begin` to poses `end`, in the frame of the first."""
    return between(poses[begin], poses[end]) - between(reference[begin], reference[end])


# --- by distance ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class RelativeError:
    """Root mean squares over all segments of the true path with the same length.

    Attributes:
        distance_m: length along the true path.
        translation_m: error of the motion from the first pose to the last, in the frame of the first.
        heading_rad: error of the turn.
        pieces: number of segments; they overlap.
    """

    distance_m: float
    translation_m: float | None
    heading_rad: float | None
    pieces: int


def relative_errors(true_poses: Float | None, estimated: Float) -> list[RelativeError] | None:
    """Return the errors over 1, 2, 5, 10, ... m up to half of the path of poses (N+1, 3); None without true poses.

    A segment begins at every pose with truth and ends at the first pose so far along (Geiger et al. 2012, KITTI).
    """
    if true_poses is None:
        return None
    known = np.isfinite(true_poses).all(axis=1) & np.isfinite(estimated).all(axis=1)
    rows = slice(None) if known.all() else known  # a slice needs no copies
    reference, poses = true_poses[rows], estimated[rows]
    way = np.concatenate([[0.0], np.hypot(*np.diff(reference[:, :2], axis=0).T).cumsum()])[: len(reference)]
    found: list[RelativeError] = []
    for distance in _lengths(float(way[-1]) if len(way) else 0.0):
        end = np.searchsorted(way, way + distance * (1 - 1e-9))
        end = end[: np.searchsorted(end, len(way))]  # last pose of the segments that begin at poses 0, 1, ...
        errors = np.empty((2, len(end)))
        for begin in chunks(len(end)):
            motions = _motion_errors(reference, poses, begin, end[begin])
            errors[:, begin] = np.hypot(*motions[:, :2].T), wrap(motions[:, 2])
        found.append(RelativeError(distance, rms(errors[0]), rms(errors[1]), len(end)))
    return found


def _lengths(way: float) -> Iterator[float]:
    power = 1.0
    while power <= LONGEST_SEGMENT * way:
        yield from (power * each for each in LENGTHS if power * each <= LONGEST_SEGMENT * way)
        power *= 10.0
