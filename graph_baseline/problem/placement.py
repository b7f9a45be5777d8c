"""Triangulation of bearing-only landmarks from a path."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.triangulation import triangulate

SURE = 0.3  # largest standard deviation of a placed landmark, relative to its distance
TRACK_BREAK = 1.0  # time without observation that ends a track [s], because the path drifts meanwhile


def tracks(recording: Recording, rows: Int) -> list[Int]:
    """Return the rows of a landmark's observations, split into tracks without long gaps."""
    stamps = recording.stamps[recording.observation_step[rows]]
    return np.split(rows, np.flatnonzero(np.diff(stamps) > TRACK_BREAK) + 1)


def triangulate_all(recording: Recording, poses: Float) -> tuple[Int, Float, Float]:
    """Return ids (L,), landmarks (L, 2) and sigmas (L,) [m] of a bearing-only recording observed from `poses`.

    Ids are increasing. A landmark is triangulated from the first track that places it, or else from all its bearings.
    Its sigma is infinite if these do not place it.
    """
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    landmarks, sigmas = np.zeros((len(ids), 2)), np.full(len(ids), np.inf)
    for slot, name in enumerate(ids.tolist()):
        landmarks[slot], sigmas[slot] = triangulate_one(recording, np.flatnonzero(recording.landmark == name), poses)
    return ids, landmarks, sigmas


def do_not_meet(recording: Recording, rows: Int, poses: Float) -> bool:
    """Return whether the bearings in `rows` from `poses` are inconsistent, though precise enough for a landmark."""
    seen_from = poses[recording.observation_step[rows]]
    found = triangulate(seen_from, recording.observation[rows, 0], recording.observation_cov[rows, 0, 0], SURE)
    distance = float(np.hypot(*(found.landmark - seen_from[:, :2]).T).min())
    return not found.placed and found.sigma < SURE * distance


def triangulate_one(recording: Recording, rows: Int, poses: Float, sure: float = SURE) -> tuple[Float, float]:
    """Return landmark (2,) and sigma [m], as in `triangulate_all`, from the bearings in `rows`."""
    landmark, bearings, variances = np.zeros(2), recording.observation[:, 0], recording.observation_cov[:, 0, 0]
    for chosen in (*tracks(recording, rows), rows):
        seen_from = poses[recording.observation_step[chosen]]
        found = triangulate(seen_from, bearings[chosen], variances[chosen], sure)
        landmark = found.landmark
        if found.placed:
            return landmark, found.sigma
    return landmark, np.inf
