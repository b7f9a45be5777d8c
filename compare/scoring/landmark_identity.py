"""Which true landmark each mapped landmark stands for, and how well observations were associated."""

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
    """What an estimate made of the observations; a figure that nobody can tell is None.

    Attributes:
        wrong_associations: observations given to a track that stands for another landmark; of clutter those
            given to one that stands for any.
        observations_rejected: observations given to no track.
        landmarks_true: distinct landmarks that were observed.
        landmarks_missed: observed landmarks that no mapped landmark stands for.
        landmarks_spurious: mapped landmarks that stand for none, doubles and tracks of clutter among them.
        track_purity: mean over tracks of the largest share of their observations that come from one landmark.
        track_purity_min: that share of the least pure track.
    """

    wrong_associations: int | None = None
    observations_rejected: int | None = None
    landmarks_true: int | None = None
    landmarks_missed: int | None = None
    landmarks_spurious: int | None = None
    track_purity: float | None = None
    track_purity_min: float | None = None


def true_landmarks(truth: Truth, recording: Recording, estimate: Estimate) -> tuple[Int, Float]:
    """True ids (L,), -1 where nobody can tell, and positions (L, 2) [m] of the estimate's landmarks.

    A recording with ids names the landmarks itself. Without them an estimator numbers its tracks as it likes; tracks
    and true landmarks are then matched one to one, so that as many observations as possible are given rightly (of
    equals, so that as few as possible are given wrongly).
    """
    ids, landmarks = estimate.landmark_ids, estimate.landmarks
    if recording.landmark is not None:
        return ids, landmarks
    owners = np.full(len(ids), NOBODY)
    if truth.association is not None and estimate.association is not None:
        from scipy.optimize import linear_sum_assignment  # here: scipy is slow to start

        names, sights = _sights(truth.association, estimate)
        foreign = sights.sum(axis=1, keepdims=True) - sights
        known = names != NOBODY
        names, sights, foreign = names[known], sights[:, known], foreign[:, known]
        rows, columns = linear_sum_assignment(sights - 1e-9 * foreign, maximize=True)
        met = sights[rows, columns] > 0
        owners[rows[met]] = names[columns[met]]
    return owners, landmarks


def association_figures(truth: Truth, recording: Recording, estimate: Estimate) -> AssociationFigures:
    """Wrong, missed, spurious; a track stands for the landmark that most of its observations come from."""
    given, true = estimate.association, truth.association
    if true is None:
        return AssociationFigures(observations_rejected=None if given is None else int(np.sum(given == NOBODY)))
    observed = _landmarks_of(true)
    owners = true_landmarks(truth, recording, estimate)[0]
    known = given is not None or recording.landmark is not None
    figures = AssociationFigures(
        landmarks_true=len(observed),
        landmarks_missed=int(np.sum(~np.isin(observed, owners))) if known else None,
        landmarks_spurious=int(np.sum(~np.isin(owners, observed))) if known else None,
    )
    if given is None:
        return figures
    names, sights, stands_for = _stands_for(true, recording, estimate)
    rightly = np.where(stands_for[:, None] == names, sights, 0).sum()
    totals = sights.sum(axis=1)
    purity = sights.max(axis=1, initial=0)[totals > 0] / totals[totals > 0]
    return figures._replace(
        wrong_associations=int(sights.sum() - rightly),
        observations_rejected=int(np.sum(given == NOBODY)),
        track_purity=float(purity.mean()) if len(purity) else None,
        track_purity_min=float(purity.min()) if len(purity) else None,
    )


def wrong_sights(truth: Truth, recording: Recording, estimate: Estimate) -> NDArray[np.bool_] | None:
    """Which observations (M,) are given to a track that stands for another landmark; None where nobody can tell."""
    given, true = estimate.association, truth.association
    if given is None or true is None:
        return None
    stands_for = _stands_for(true, recording, estimate)[2]
    wrong = np.zeros(len(given), dtype=np.bool_)
    for accepted, row in _accepted(estimate):
        wrong[accepted] = stands_for[row] != true[accepted]
    return wrong


def _stands_for(true: Int, recording: Recording, estimate: Estimate) -> tuple[Int, Int, Int]:
    """What `_sights` returns, and the true landmark (L,) that each mapped one stands for, NOBODY for none."""
    names, sights = _sights(true, estimate)
    ids = np.asarray(estimate.landmark_ids)
    if recording.landmark is not None:
        return names, sights, np.where(np.isin(ids, _landmarks_of(true)), ids, NOBODY)
    return names, sights, names[sights.argmax(axis=1)] if len(names) else np.full(len(ids), NOBODY)


def _sights(true: Int, estimate: Estimate) -> tuple[Int, Int]:
    """Observed landmarks (T,), and how many of the observations of each (L, T) every mapped landmark was given.

    Clutter is among them, as that of NOBODY.
    """
    names = distinct(true)
    sights = np.zeros((len(estimate.landmark_ids), len(names)), dtype=np.int64)
    for accepted, row in _accepted(estimate):
        np.add.at(sights, (row, np.searchsorted(names, true[accepted])), 1)
    return names, sights


def _accepted(estimate: Estimate) -> Iterator[tuple[Int, Int]]:
    """Observations (m,) that were given to a track, and its row (m,) in the map; some thousands at a time."""
    ids, given = estimate.landmark_ids, estimate.association
    assert given is not None
    order = np.argsort(ids)
    for rows in chunks(len(given)):
        accepted = rows.start + np.flatnonzero(given[rows] != NOBODY)
        yield accepted, order[np.searchsorted(ids, given[accepted], sorter=order)]


def _landmarks_of(true: Int) -> Int:
    """Distinct ids of the landmarks that were observed, clutter left out."""
    names = distinct(true)
    return names[names != NOBODY]


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
