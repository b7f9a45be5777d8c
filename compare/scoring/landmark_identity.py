"""True landmarks of the mapped landmarks, and figures of the data association."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int, chunks, distinct
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth


class AssociationFigures(NamedTuple):
    """Figures of the data association, defined in `catalogue`; None if unknown.

    A track is a mapped landmark with its observations; clutter on the track of a landmark is a wrong association.
    """

    wrong_associations: int | None = None
    landmarks_true: int | None = None
    landmarks_missed: int | None = None


def true_landmarks(truth: Truth, recording: Recording, estimate: Estimate) -> tuple[Int, Float]:
    """Return true ids (L,), -1 if unknown, and positions (L, 2) [m] of the estimate's landmarks.

    A recording with ids names the landmarks. Without ids, tracks and true landmarks are matched one to one, with as
    many right associations as possible, and among these matches with as few wrong ones as possible.
    """
    ids, landmarks = estimate.landmark_ids, estimate.landmarks
    if recording.landmark is not None:
        return ids, landmarks
    owners = np.full(len(ids), NOBODY)
    if truth.association is not None and estimate.association is not None:
        from scipy.optimize import linear_sum_assignment  # here: scipy is slow to start

        names, counts = _counts(truth.association, estimate)
        foreign = counts.sum(axis=1, keepdims=True) - counts
        known = names != NOBODY
        names, counts, foreign = names[known], counts[:, known], foreign[:, known]
        rows, columns = linear_sum_assignment(counts - 1e-9 * foreign, maximize=True)
        met = counts[rows, columns] > 0
        owners[rows[met]] = names[columns[met]]
    return owners, landmarks


def association_figures(truth: Truth, recording: Recording, estimate: Estimate) -> AssociationFigures:
    """Return the figures; a track belongs to the landmark from which most of its observations come."""
    if truth.association is None:
        return AssociationFigures()
    observed = _landmarks_of(truth.association)
    wrong, missed = wrongly_associated(truth, recording, estimate), None
    if estimate.association is not None or recording.landmark is not None:
        missed = int(np.sum(~np.isin(observed, true_landmarks(truth, recording, estimate)[0])))
    return AssociationFigures(None if wrong is None else int(wrong.sum()), len(observed), missed)


def wrongly_associated(truth: Truth, recording: Recording, estimate: Estimate) -> NDArray[np.bool_] | None:
    """Return which observations (M,) are assigned to a track of another landmark; None if unknown."""
    given, true = estimate.association, truth.association
    if given is None or true is None:
        return None
    ids = np.asarray(estimate.landmark_ids)
    if recording.landmark is not None:
        main = np.where(np.isin(ids, _landmarks_of(true)), ids, NOBODY)
    else:
        names, counts = _counts(true, estimate)
        main = names[counts.argmax(axis=1)] if len(names) else np.full(len(ids), NOBODY)
    wrong = np.zeros(len(given), dtype=np.bool_)
    for accepted, row in _accepted(estimate):
        wrong[accepted] = main[row] != true[accepted]
    return wrong


def _counts(true: Int, estimate: Estimate) -> tuple[Int, Int]:
    """Return distinct ids (T,) of observed landmarks and clutter, and numbers (L, T) of their observations by track."""
    names = distinct(true)
    counts = np.zeros((len(estimate.landmark_ids), len(names)), dtype=np.int64)
    for accepted, row in _accepted(estimate):
        np.add.at(counts, (row, np.searchsorted(names, true[accepted])), 1)
    return names, counts


def _accepted(estimate: Estimate) -> Iterator[tuple[Int, Int]]:
    """Yield observations (m,) with a track, and the track's row (m,) in the map, some thousands at a time."""
    ids, given = estimate.landmark_ids, estimate.association
    assert given is not None
    order = np.argsort(ids)
    for rows in chunks(len(given)):
        accepted = rows.start + np.flatnonzero(given[rows] != NOBODY)
        yield accepted, order[np.searchsorted(ids, given[accepted], sorter=order)]


def _landmarks_of(true: Int) -> Int:
    """Return the distinct ids of the observed landmarks, without clutter."""
    names = distinct(true)
    return names[names != NOBODY]


def landmark_errors(ids: Int, landmarks: Float, known_ids: Int | None, known: Float | None) -> Float:
    """Return differences (L, 2) [m] between `landmarks` and those of the same id in `known`; NaN without one."""
    errors = np.full(landmarks.shape, np.nan)
    if known_ids is None or known is None or not len(known_ids):
        return errors
    distinct, first = np.unique(known_ids, return_index=True)
    slot = np.searchsorted(distinct, ids).clip(max=len(distinct) - 1)
    common = (distinct[slot] == ids) & (ids != NOBODY)
    errors[common] = landmarks[common] - known[first[slot[common]]]
    return errors
