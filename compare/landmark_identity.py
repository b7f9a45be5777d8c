"""Which true landmark each mapped landmark stands for, so that maps can be compared id by id."""

from __future__ import annotations

import numpy as np

from slam2d import Estimate, Float, Int, Recording, Truth

NOBODY = -1


def true_landmarks(truth: Truth, recording: Recording, estimate: Estimate) -> tuple[Int, Float]:
    """True ids (L,), -1 where nobody can tell, and positions (L, 2) [m] of the estimate's landmarks.

    A recording with ids names the landmarks itself. Without them an estimator numbers its tracks as it likes, and
    a track stands for the landmark whose observation started it.
    """
    ids, landmarks = estimate.landmark_ids, estimate.landmarks
    assert ids is not None and landmarks is not None  # filled by Estimate's constructor
    if recording.landmark is not None:
        return ids, landmarks
    owners = np.full(len(ids), NOBODY)
    if truth.association is not None and estimate.association is not None:
        tracks, first = np.unique(estimate.association, return_index=True)
        _, mapped, found = np.intersect1d(ids, tracks, return_indices=True)
        owners[mapped] = truth.association[first[found]]
    return owners, landmarks


def wrong_associations(truth: Truth, recording: Recording, estimate: Estimate) -> int | None:
    """Number of accepted observations that were given to another landmark than their own; None if unknown."""
    if truth.association is None or estimate.association is None:
        return None
    given = estimate.association
    if recording.landmark is None:
        _, first, track = np.unique(given, return_index=True, return_inverse=True)
        given = np.where(given == NOBODY, NOBODY, truth.association[first][track])
    return int(np.sum((given != NOBODY) & (given != truth.association)))


def landmark_errors(ids: Int, landmarks: Float, known_ids: Int | None, known: Float | None) -> Float:
    """Differences (L, 2) [m] between `landmarks` and those of the same id in `known`; NaN without a counterpart."""
    errors = np.full(landmarks.shape, np.nan)
    if known_ids is None or known is None or not len(known_ids):
        return errors
    distinct, first = np.unique(known_ids, return_index=True)
    slot = np.searchsorted(distinct, ids).clip(max=len(distinct) - 1)
    common = (distinct[slot] == ids) & (ids != NOBODY)
    errors[common] = landmarks[common] - known[first[slot[common]]]
    return errors
