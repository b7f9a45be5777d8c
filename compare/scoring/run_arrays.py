"""An estimate with what it is compared with: the arrays from which its metrics follow, each computed once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamgauge.arrays import Float, Int, Marks, chunks, distinct
from slamgauge.compare.scoring.consistency import distances, pose_errors, squared_mahalanobis
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth

ABSENCE = 10.0  # s: a step closes a loop if it re-observes a landmark that was not observed for this time
ROUNDING = 1e-6  # rounding error [s] of stamps such as 0.1 k


@dataclass(frozen=True)
class RunArrays:
    """An estimate, the known part of the truth, and the optimum of the same kind.

    A mapped landmark with its observations is a track. Figures that need an unknown part of the truth are undefined.
    """

    truth: Truth
    recording: Recording
    estimate: Estimate
    optimum: Estimate | None = None  # None: not compared
    compared: Marks | None = None  # (N+1,) the steps of which a stored trajectory has a pose; None: all

    @cached_property
    def reference(self) -> Float:
        """True poses (N+1, 3); NaN where they are not known or not compared."""
        poses = np.full(self.estimate.poses.shape, np.nan) if self.truth.poses is None else self.truth.poses
        return poses if self.compared is None else np.where(self.compared[:, None], poses, np.nan)

    @cached_property
    def errors(self) -> Float:
        """Additive errors (N+1, 3) of the poses [m, m, rad]."""
        return pose_errors(self.reference, self.estimate.poses)

    @cached_property
    def off(self) -> Float:
        """Position errors (N+1,) [m]."""
        return distances(self.errors)

    @cached_property
    def covs(self) -> Float:
        """Covariances (N+1, 3, 3) of the poses, all NaN if the estimator returns none."""
        return pose_covs_of(self.estimate)

    @cached_property
    def sigmas(self) -> Float:
        """Standard deviations (N+1, 3) of x, y [m] and heading [rad]."""
        return np.sqrt(np.diagonal(self.covs, axis1=1, axis2=2).clip(min=0))

    @cached_property
    def nees(self) -> Float:
        """NEES (N+1,) of the poses."""
        return squared_mahalanobis(self.errors, self.covs)

    @cached_property
    def nees_xy(self) -> Float:
        """NEES (N+1,) of the positions."""
        return squared_mahalanobis(self.errors[:, :2], self.covs[:, :2, :2])

    @cached_property
    def observed(self) -> Int | None:
        """Distinct true ids of the observed landmarks; None if unknown."""
        return None if self.truth.association is None else np.setdiff1d(distinct(self.truth.association), NOBODY)

    @cached_property
    def true_ids(self) -> Int:
        """True ids (L,) of the mapped landmarks, -1 if unknown.

        A recording with ids names the landmarks. Without ids, tracks and true landmarks are matched one to one, with as
        many right associations as possible, and among these matches with as few wrong ones as possible.
        """
        if self.recording.landmark is not None:
            return self.estimate.landmark_ids
        owners = np.full(len(self.estimate.landmark_ids), NOBODY)
        if self.truth.association is not None and self.estimate.association is not None:
            from scipy.optimize import linear_sum_assignment  # here: scipy is slow to start

            names, counts = self._counts(self.truth.association)
            foreign = counts.sum(axis=1, keepdims=True) - counts
            known = names != NOBODY
            rows, columns = linear_sum_assignment((counts - 1e-9 * foreign)[:, known], maximize=True)
            met = counts[:, known][rows, columns] > 0
            owners[rows[met]] = names[known][columns[met]]
        return owners

    @cached_property
    def wrong(self) -> Marks | None:
        """Observations (M,) assigned to a track of another landmark; None if unknown.

        A track belongs to the landmark, or to clutter, from which most of its observations come.
        """
        true, ids = self.truth.association, self.estimate.landmark_ids
        if true is None or self.estimate.association is None:
            return None
        if self.recording.landmark is not None and self.observed is not None:
            main = np.where(np.isin(ids, self.observed), ids, NOBODY)
        else:
            names, counts = self._counts(true)
            main = names[counts.argmax(axis=1)] if len(names) else np.full(len(ids), NOBODY)
        wrong = np.zeros(len(true), dtype=np.bool_)
        for accepted, rows in self._accepted():
            wrong[accepted] = main[rows] != true[accepted]
        return wrong

    def _counts(self, true: Int) -> tuple[Int, Int]:
        """Return distinct ids (T,) of observed landmarks and clutter, and numbers (L, T) of their observations."""
        names = distinct(true)
        counts = np.zeros((len(self.estimate.landmark_ids), len(names)), dtype=np.int64)
        for accepted, rows in self._accepted():
            np.add.at(counts, (rows, np.searchsorted(names, true[accepted])), 1)
        return names, counts

    def _accepted(self) -> Iterator[tuple[Int, Int]]:
        """Yield observations (m,) with a track, and its row (m,) in the map, some thousands at a time."""
        ids, given = self.estimate.landmark_ids, self.estimate.association
        assert given is not None
        order = np.argsort(ids)
        for rows in chunks(len(given)):
            accepted = rows.start + np.flatnonzero(given[rows] != NOBODY)
            yield accepted, order[np.searchsorted(ids, given[accepted], sorter=order)]

    def from_truth(self, ids: Int, points: Float) -> Float:
        """Return differences (n, 2) [m] between points and the true landmarks of these ids; NaN without one."""
        known, places, nowhere = self.truth.landmark_ids, self.truth.landmarks, np.full(2, np.nan)
        true = {} if known is None or places is None else dict(zip(known.tolist(), places, strict=True))
        return points - np.array([true.get(name, nowhere) for name in ids.tolist()]).reshape(-1, 2)

    @cached_property
    def map_errors(self) -> Float:
        """Errors (L, 2) of the mapped landmarks [m]; NaN for those of unknown truth."""
        return self.from_truth(self.true_ids, self.estimate.landmarks)

    @cached_property
    def map_off(self) -> Float:
        """Position errors (L,) of the mapped landmarks [m]."""
        return distances(self.map_errors)

    @cached_property
    def map_covs(self) -> Float:
        """Covariances (L, 2, 2) of the mapped landmarks, all NaN if the estimator returns none."""
        covs = self.estimate.landmark_covs
        return np.full((len(self.map_errors), 2, 2), np.nan) if covs is None else covs

    @cached_property
    def map_nees(self) -> Float:
        """NEES (L,) of the mapped landmarks."""
        return squared_mahalanobis(self.map_errors, self.map_covs)


def closure_steps(truth: Truth | None, recording: Recording) -> Int | None:
    """Return the increasing steps of the loop closures, by the recording's ids or the truth's; None without ids."""
    ids = recording.landmark
    if ids is None:
        ids = None if truth is None else truth.association
    if ids is None:
        return None
    names, found = distinct(ids), [np.zeros(0, dtype=np.int64)]
    last = np.full(len(names), np.inf)  # time of the last observation of each landmark
    for rows in chunks(len(ids)):
        of_landmarks = np.flatnonzero(ids[rows] != NOBODY)
        slot, step = np.searchsorted(names, ids[rows][of_landmarks]), recording.observation_step[rows][of_landmarks]
        order = np.argsort(slot, kind="stable")  # sorted by landmark, then by time
        slot, step, stamp = slot[order], step[order], recording.stamps[step[order]]
        before = np.where(np.diff(slot, prepend=-1) != 0, last[slot], np.roll(stamp, 1))
        found.append(step[stamp - before >= ABSENCE - ROUNDING])
        last[slot] = stamp  # the last one counts
    return np.unique(np.concatenate(found))


def pose_covs_of(estimate: Estimate) -> Float:
    """Return the pose covariances (N+1, 3, 3), all NaN if the estimator returns none."""
    return np.full((len(estimate.poses), 3, 3), np.nan) if estimate.pose_covs is None else estimate.pose_covs
