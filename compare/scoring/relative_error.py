"""Relative pose errors over distances: how far a path drifts on its way, wherever that begins."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, chunks
from slamgauge.compare.scoring.nan_stats import rms
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, wrap
from slamgauge.truth import Truth

ROUND = (1.0, 2.0, 5.0)  # times powers of ten [m]
LONGEST = 0.5  # of the true path: half of its poses begin a piece, at least


class RelativeError(NamedTuple):
    """Root mean squares over the pieces of the true path of a length.

    Attributes:
        distance_m: along the true path.
        translation_m: error of the motion from the first pose of a piece to its last, in the frame of the first.
        heading_rad: of its turn.
        pieces: how many there are; they overlap.
    """

    distance_m: float
    translation_m: float | None
    heading_rad: float | None
    pieces: int


def relative_errors(truth: Truth, _recording: Recording, estimate: Estimate) -> list[dict[str, float | None]] | None:
    """A `RelativeError` for each of the distances 1, 2, 5, 10, ... m up to half of the path; None without true poses.

    A piece begins at every pose with truth and ends at the first that is so far on (Geiger et al. 2012, KITTI).
    """
    if truth.poses is None:
        return None
    known = np.isfinite(truth.poses).all(axis=1) & np.isfinite(estimate.poses).all(axis=1)
    rows = slice(None) if known.all() else known  # a slice needs no copies
    reference, poses = truth.poses[rows], estimate.poses[rows]
    way = np.concatenate([[0.0], np.hypot(*np.diff(reference[:, :2], axis=0).T).cumsum()])[: len(reference)]
    found: list[dict[str, float | None]] = []
    for distance in _distances(float(way[-1]) if len(way) else 0.0):
        end = _ends(way, distance)
        errors = np.empty((2, len(end)))
        for begin in chunks(len(end)):
            errors[:, begin] = _of_pieces(reference, poses, begin, end[begin])
        found.append(RelativeError(distance, rms(errors[0]), rms(errors[1]), len(end))._asdict())
    return found


def _of_pieces(reference: Float, poses: Float, begin: slice, end: Int) -> tuple[Float, Float]:
    """Errors of the pieces (n,) from pose `begin` to pose `end`: [m], and of the turn [rad]."""
    errors = between(poses[begin], poses[end]) - between(reference[begin], reference[end])
    return np.hypot(*errors[:, :2].T), wrap(errors[:, 2])


def _ends(way: Float, distance: float) -> Int:
    """Last pose (n,) of every piece of a length [m], which begin at poses 0..n-1; pose k (N,) is `way[k]` [m] along."""
    end = np.searchsorted(way, way + distance * (1 - 1e-9))
    return end[: np.searchsorted(end, len(way))]


def _distances(way: float) -> Iterator[float]:
    power = 1.0
    while power <= LONGEST * way:
        yield from (power * each for each in ROUND if power * each <= LONGEST * way)
        power *= 10.0
