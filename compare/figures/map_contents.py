"""Contents of a map at a step: points and rays, first observations, lines of sight, and limits of the axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks, chunks
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

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

    def only(self, kept: Marks | slice) -> MapRows:
        """Return the rows of a mask (K,) or a slice."""
        return MapRows(self.landmark[kept], self.member[kept], self.weight[kept], self.position[kept], self.cov[kept])


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


def sight_lines(recording: Recording, estimate: Estimate, after: int, step: int) -> Float:
    """Return lines (m, 2, 2) [m] from robot to mapped landmark, for the last scan after the step `after` up to `step`.

    Positions are those of the estimate. Without ids the result is empty.
    """
    seen = recording.landmark if estimate.association is None else estimate.association
    first, last = np.searchsorted(recording.observation_step, [after, step], side="right")
    if first == last or seen is None:
        return np.zeros((0, 2, 2))
    at = int(recording.observation_step[last - 1])
    scan = slice(int(np.searchsorted(recording.observation_step, at)), int(last))
    which = np.nonzero(seen[scan, None] == estimate.landmark_ids)[1]
    start = np.broadcast_to(estimate.poses[at, :2], (len(which), 2))
    return np.stack([start, estimate.landmarks[which]], axis=1)


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
