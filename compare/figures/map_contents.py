"""Contents of a map at a step: points and rays, first observations, lines of sight, and limits of the axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int, chunks
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

EQUAL = 1e-9  # weights that differ by less count as equal
NEVER = np.iinfo(np.int64).max
MARGIN = 0.06  # relative to the extent of the map, on each side
ROOM = 0.15  # the same, for positions that may diverge


class MapRows(NamedTuple):
    """Rows of a `MapHistory` at one step; each is a point or a member of a ray."""

    landmark: Int  # (K,) ids
    member: Int  # (K,) numbers of the members along their ray, -1 for a point
    weight: Float  # (K,) probabilities of the members, 1 for a point
    position: Float  # (K, 2) [m]
    cov: Float  # (K, 2, 2) [m^2]

    def only(self, kept: NDArray[np.bool_] | slice) -> MapRows:
        """Return the rows of a mask (K,) or a slice."""
        return MapRows(self.landmark[kept], self.member[kept], self.weight[kept], self.position[kept], self.cov[kept])

    def heaviest(self) -> NDArray[np.bool_]:
        """Return a mask (K,) of the most likely member of each ray; rays with equal weights have none."""
        same = (self.landmark[:, None] == self.landmark) & (self.member >= 0)
        rivals = np.sum(same & (self.weight[:, None] <= self.weight + EQUAL), axis=1)
        return (self.member >= 0) & (rivals == 1)


def map_at(estimate: Estimate, step: int) -> MapRows:
    """Return the last map that the history recorded up to a step; empty before the first one.

    Rays that were lost since that record, according to the log of rays, are removed.
    """
    history, log = estimate.history, estimate.rays
    assert history is not None
    end = int(np.searchsorted(history.step, step, side="right"))
    recorded = int(history.step[end - 1]) if end else step
    everything = MapRows(history.landmark, history.member, history.weight, history.position, history.cov)
    rows = everything.only(slice(int(np.searchsorted(history.step, recorded)), end))
    if log is None:
        return rows
    lost = (log.birth <= recorded) & (recorded < log.end) & (log.end <= step) & (log.survivor < 0)
    return rows.only((rows.member < 0) | ~np.isin(rows.landmark, log.landmark[lost]))


def first_seen(recording: Recording, estimate: Estimate) -> Int:
    """Return the steps (L,) at which the landmarks of the estimate were first observed; 0 if ids are unknown."""
    ids = estimate.landmark_ids
    seen = recording.landmark if estimate.association is None else estimate.association
    if seen is None:
        return np.zeros(len(ids), np.int64)
    steps = np.full(len(ids), NEVER)
    for rows in reversed([*chunks(len(seen))]):
        names, first = np.unique(seen[rows], return_index=True)
        found = np.isin(ids, names)
        steps[found] = recording.observation_step[rows][first[np.searchsorted(names, ids[found])]]
    return steps


def sight_lines(truth: Truth, recording: Recording, estimate: Estimate, after: int, step: int) -> Float:
    """Return lines (m, 2, 2) [m] from robot to landmark, for the last scan after the step `after` up to `step`.

    Positions are the true ones if the truth is complete, else those of the estimate. Without ids the result is empty.
    """
    first, last = np.searchsorted(recording.observation_step, [after, step], side="right")
    if first == last:
        return np.zeros((0, 2, 2))
    at = int(recording.observation_step[last - 1])
    scan = slice(int(np.searchsorted(recording.observation_step, at)), int(last))
    true_ids = recording.landmark if truth.association is None else truth.association
    estimated_ids = recording.landmark if estimate.association is None else estimate.association
    if truth.poses is not None and truth.landmark_ids is not None and true_ids is not None:
        ids, names, places, start = true_ids[scan], truth.landmark_ids, truth.landmarks, truth.poses[at, :2]
    else:
        ids, names, places, start = estimated_ids, estimate.landmark_ids, estimate.landmarks, estimate.poses[at, :2]
        ids = np.zeros(0, np.int64) if ids is None else ids[scan]
    assert names is not None and places is not None
    which = np.nonzero(ids[:, None] == names)[1]
    return np.stack([np.broadcast_to(start, (len(which), 2)), places[which]], axis=1)


def map_limits(sure: Sequence[Float], others: Sequence[Float]) -> tuple[Float, Float]:
    """Return corners low and high (2,) [m] around all `sure` positions (n, 2), and the `others` up to a margin.

    Rows of NaN (gaps of a ground truth) are ignored.
    """
    low, high = _corners(sure)
    extent = (high - low).max() or 1.0  # a single position needs an extent too
    lowest, highest = _corners([*sure, *others])
    low = np.maximum(lowest, low - ROOM * extent) - MARGIN * extent
    high = np.minimum(highest, high + ROOM * extent) + MARGIN * extent
    return low, high


def _corners(places: Sequence[Float]) -> tuple[Float, Float]:
    """Return the smallest and the largest coordinates (2,) of positions (n, 2), without copying these."""
    low = np.min([np.fmin.reduce(each, axis=0, initial=np.inf) for each in places], axis=0)
    return low, np.max([np.fmax.reduce(each, axis=0, initial=-np.inf) for each in places], axis=0)
