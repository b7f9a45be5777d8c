"""First observations of landmarks, and lines from robot to landmark, for figures."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, chunks
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

NEVER = np.iinfo(np.int64).max


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
