"""Which landmark is which: true landmarks of the mapped ones, figures of the data association, loop closures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth

ABSENCE = 10.0  # s: a step closes a loop if it re-observes a landmark that was not observed for this time
ROUNDING = 1e-6  # rounding error [s] of stamps such as 0.1 k


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
    if recording.landmark is not None:
        return estimate.landmark_ids, estimate.landmarks
    owners = np.full(len(estimate.landmark_ids), NOBODY)
    if truth.association is not None and estimate.association is not None:
        from scipy.optimize import linear_sum_assignment  # here: scipy is slow to start

        names, counts = _counts(truth.association, estimate)
        foreign = counts.sum(axis=1, keepdims=True) - counts
        known = names != NOBODY
        names, counts, foreign = names[known], counts[:, known], foreign[:, known]
        rows, columns = linear_sum_assignment(counts - 1e-9 * foreign, maximize=True)
        met = counts[rows, columns] > 0
        owners[rows[met]] = names[columns[met]]
    return owners, estimate.landmarks


def association_figures(truth: Truth, recording: Recording, estimate: Estimate) -> AssociationFigures:
    """Return the figures; a track belongs to the landmark from which most of its observations come."""
    if truth.association is None:
        return AssociationFigures()
    observed = np.setdiff1d(truth.association, NOBODY)
    wrong, missed = wrongly_associated(truth, recording, estimate), None
    if estimate.association is not None or recording.landmark is not None:
        missed = int(np.sum(~np.isin(observed, true_landmarks(truth, recording, estimate)[0])))
    return AssociationFigures(None if wrong is None else int(wrong.sum()), len(observed), missed)


def wrongly_associated(truth: Truth, recording: Recording, estimate: Estimate) -> Marks | None:
    """Return which observations (M,) are assigned to a track of another landmark; None if unknown."""
    if estimate.association is None or truth.association is None:
        return None
    ids = estimate.landmark_ids
    if recording.landmark is not None:
        main = np.where(np.isin(ids, truth.association), ids, NOBODY)
    else:
        names, counts = _counts(truth.association, estimate)
        main = names[counts.argmax(axis=1)] if len(names) else np.full(len(ids), NOBODY)
    wrong = np.zeros(len(estimate.association), dtype=np.bool_)
    accepted, rows = _accepted(estimate, estimate.association)
    wrong[accepted] = main[rows] != truth.association[accepted]
    return wrong


def _counts(true: Int, estimate: Estimate) -> tuple[Int, Int]:
    """Return distinct ids (T,) of observed landmarks and clutter, and numbers (L, T) of their observations by track."""
    assert estimate.association is not None
    names, column = np.unique(true, return_inverse=True)
    counts = np.zeros((len(estimate.landmark_ids), len(names)), dtype=np.int64)
    accepted, rows = _accepted(estimate, estimate.association)
    np.add.at(counts, (rows, column[accepted]), 1)
    return names, counts


def _accepted(estimate: Estimate, association: Int) -> tuple[Int, Int]:
    """Return observations (m,) with a track, and the track's row (m,) in the map."""
    accepted, order = np.flatnonzero(association != NOBODY), np.argsort(estimate.landmark_ids)
    return accepted, order[np.searchsorted(estimate.landmark_ids, association[accepted], sorter=order)]


def landmark_errors(ids: Int, landmarks: Float, known_ids: Int | None, known: Float | None) -> Float:
    """Return differences (L, 2) [m] between `landmarks` and those of the same id in `known`; NaN without one."""
    errors = np.full(landmarks.shape, np.nan)
    if known_ids is None or known is None or not len(known_ids):
        return errors
    names, first = np.unique(known_ids, return_index=True)
    slot = np.searchsorted(names, ids).clip(max=len(names) - 1)
    common = (names[slot] == ids) & (ids != NOBODY)
    errors[common] = landmarks[common] - known[first[slot[common]]]
    return errors


def closure_steps(truth: Truth | None, recording: Recording) -> Int | None:
    """Return the increasing steps of the loop closures, by the recording's ids or the truth's; None without ids."""
    ids = recording.landmark
    if ids is None:
        ids = None if truth is None else truth.association
    if ids is None:
        return None
    observed = np.flatnonzero(ids != NOBODY)
    order = observed[np.argsort(ids[observed], kind="stable")]  # sorted by landmark, then by time
    step = recording.observation_step[order]
    is_absent = np.diff(recording.stamps[step]) >= ABSENCE - ROUNDING
    return np.unique(step[1:][is_absent & (np.diff(ids[order]) == 0)])
