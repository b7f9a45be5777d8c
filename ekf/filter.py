"""The online filter: what a robot calls at every step."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels import linear, map_edits
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.compatibility import Pairs, allocate_pairs, find_compatible
from slamgauge.ekf.kernels.corrections import (
    MAX_ITERATIONS,
    retract_right_invariant,
    retract_standard,
    update_iterated,
    update_right_invariant,
    update_standard,
)
from slamgauge.ekf.kernels.joint_search import mark_ambiguous, search_jointly
from slamgauge.ekf.kernels.linearisation import describe
from slamgauge.ekf.kernels.models import BEARING, RANGE_BEARING, SENSOR_CODES
from slamgauge.ekf.kernels.one_by_one import update_one_by_one
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.slots import find_slots
from slamgauge.ekf.kernels.warm_up import compile_once
from slamgauge.ekf.kernels.workspace import Workspace, allocate
from slamgauge.recording import Observations

Correction = Literal["standard", "first-estimates", "iterated", "right-invariant"]
Update = Callable[[int, Float, Float, Float, int, int, Workspace], tuple[float, int]]
Retract = Callable[[Float, Float, int, Workspace], None]

WHOLE_SCAN = sys.maxsize
BLOCK = 16  # observations that an update takes in at a time; see docs/performance.md

SOUND = "make every value finite and every covariance positive definite; if they are, the filter has diverged"


class Rule(NamedTuple):
    """How a filter corrects.

    Attributes:
        update: takes in a scan.
        retract: moves the state by a correction that is not an observation's (see `map_edits`).
        first_estimates: whether Jacobians are taken at first estimates.
        passes: linearisations of an update at most.
        block: observations to take in at a time.
    """

    update: Update
    retract: Retract = retract_standard
    first_estimates: bool = False
    passes: int = 1
    block: int = BLOCK


RULES: dict[str, Rule] = {
    "standard": Rule(update_standard),
    "first-estimates": Rule(update_standard, first_estimates=True),
    "iterated": Rule(update_iterated, passes=MAX_ITERATIONS, block=WHOLE_SCAN),
    "right-invariant": Rule(update_right_invariant, retract_right_invariant),
}


class SlamFilter:
    """Landmark EKF-SLAM with known association and one blocked update per step.

    `ekf.association.AssociatingFilter` puts an association on top, with the methods that speak of slots:
    rows of `landmarks`. A slot stays a landmark's own until `remove` or `merge`.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: `standard`, `first-estimates`, `iterated`, `right-invariant` (see `kernels.corrections`), or a
            rule of your own.
        landmarks: how many to make room for at first; the filter grows beyond that by itself.

    Raises:
        ValueError: the sensor is not one that this filter can use.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction | Rule = "standard",
        landmarks: int = 32,
    ) -> None:
        if sensor not in SENSOR_CODES:
            raise ValueError(f"sensor: {sensor!r} does not fit this filter; use one of {', '.join(SENSOR_CODES)}")
        compile_once()
        self._sensor = SENSOR_CODES[sensor]
        self._rule = RULES[correction] if isinstance(correction, str) else correction
        self._ids: Int = np.zeros(0, dtype=np.int64)  # in slot order
        self._sorted_ids: Int = self._ids
        self._sorted_slots: Int = self._ids
        self._size = 3
        capacity = 3 + 2 * landmarks
        self._state = np.zeros(capacity)
        self._cov = np.zeros((capacity, capacity))
        self._state[:3] = prior_mean
        self._cov[:3, :3] = prior_cov
        self._point = self._state.copy() if self._rule.first_estimates else self._state
        self._increment = np.zeros(3)
        self._increment_cov = np.zeros((3, 3))
        self._work = allocate(0, capacity, self._rule.block)
        self._pairs = allocate_pairs(0)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._state[:3].copy()

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._cov[:3, :3].copy()

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks: in the order of their first sight, unless some were removed."""
        return self._ids.copy()

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self._state[3 : self._size].reshape(-1, 2).copy()

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        first = np.arange(3, self._size, 2)
        xx, xy, yy = self._cov[first, first], self._cov[first, first + 1], self._cov[first + 1, first + 1]
        return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of robot and landmarks in the order of `landmark_ids`."""
        upper = np.triu(self._cov[: self._size, : self._size])
        return upper + np.triu(upper, 1).T

    def set_map(self, landmark_ids: Int, landmarks: Float, cov: Float) -> None:
        """Replace the map: ids (L,), positions (L, 2), and the covariance (3 + 2L, 3 + 2L) with the robot first."""
        size = 3 + 2 * len(landmark_ids)
        self._reserve(size)
        self._size = size
        self._state[3:size] = self._point[3:size] = np.ravel(landmarks)
        self._cov[:size, :size] = cov
        self._work.points[:] = True
        self._index(landmark_ids)

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            ValueError: a number is not finite; the filter is unchanged.
        """
        self._increment[:] = increment
        self._increment_cov[:] = cov
        if not predict(self._state, self._point, self._cov, self._size, self._increment, self._increment_cov):
            raise ValueError(f"increment: {increment} or its covariance is not finite; drop the step or repair it")

    def update(self, observations: Observations) -> tuple[float, int]:
        """Correct with all observations of one step, then map the landmarks that are new.

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without mapped landmarks).

        Raises:
            ValueError: no ids, shapes that do not fit, or an update that has no solution because a
                number is not finite or a covariance not positive definite; the filter is then unchanged,
                unless it had diverged (its own covariance no longer positive definite).
        """
        ids, values, covs = observations
        if ids is None:
            raise ValueError("landmark: this filter needs known association; give the ids of the observations")
        count = len(ids)
        if count == 0:
            return 0.0, 0
        work = self._room_for(count)
        work.ids[:count] = ids
        unmapped = find_slots(self._sorted_ids, self._sorted_slots, work.ids[:count], work.slots)
        if unmapped:
            return self._update_and_map(np.asarray(ids), np.asarray(values), np.asarray(covs))
        return self._correct(count, values, covs)

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, d), (m, d, d) of the landmarks in `slots` (m,); returns as `update`."""
        count = len(slots)
        if count == 0:
            return 0.0, 0
        self._room_for(count).slots[:count] = slots
        return self._correct(count, values, covs)

    def _correct(self, count: int, values: Float, covs: Float) -> tuple[float, int]:
        work = self._work
        self._load(values, covs)
        nis, informative = self._rule.update(self._sensor, self._state, self._point, self._cov, self._size, count, work)
        if not np.isfinite(nis):
            raise ValueError(
                f"observation: no update exists for landmarks {self._ids[work.slots[:count]].tolist()}; {SOUND}"
            )
        return nis, informative

    def _load(self, values: Float, covs: Float) -> None:
        """Put observations (m, d), (m, d, d) into the workspace; a bearing alone is the second of its two rows."""
        values = np.asarray(values)
        count, first = len(values), 2 - values.shape[1]
        self._work.observation_cov[:count] = np.eye(2)
        self._work.observation[:count, first:] = values
        self._work.observation_cov[:count, first:, first:] = covs

    def _room_for(self, count: int) -> Workspace:
        if count > len(self._work.ids):
            self._renew_workspace(count)
        return self._work

    def _renew_workspace(self, observations: int) -> None:
        points = self._work.points
        self._work = allocate(observations, len(self._state), self._rule.block)
        self._work.points[: len(points)] = points

    def _update_and_map(self, ids: Int, values: Float, covs: Float) -> tuple[float, int]:
        """An update in which some landmarks are new: first the mapped ones, then augmentation.

        A new landmark that is seen more than once in the step is mapped by its first sight; the
        others correct it in an update of their own.
        """
        if self._sensor == BEARING:
            raise ValueError(
                "landmark: a bearing alone places no landmark; use slamgauge.ekf.bearings.bearing_filter.BearingFilter"
            )
        if not (np.isfinite(values).all() and np.isfinite(covs).all() and (np.linalg.eigvalsh(covs) > 0).all()):
            raise ValueError("observation: a value is not finite, or a covariance not positive definite; drop the row")
        mapped = np.isin(ids, self._ids)
        first = np.zeros(len(ids), dtype=bool)
        first[np.unique(ids, return_index=True)[1]] = True
        new = first & ~mapped
        again = ~first & ~mapped
        total, dof = 0.0, 0
        if mapped.any():
            total, dof = self.update(Observations(ids[mapped], values[mapped], covs[mapped]))
        self.add(ids[new], values[new], covs[new])
        if again.any():
            nis, informative = self.update(Observations(ids[again], values[again], covs[again]))
            total, dof = total + nis, dof + informative
        return total, dof

    def add(self, ids: Int, values: Float, covs: Float) -> None:
        """Map new landmarks (m,) at their first sights (m, d), with covariances (m, d, d).

        With a bearing sensor the sights are made up of a range and a bearing.
        """
        count = len(ids)
        self._reserve(self._size + 2 * count)
        self._room_for(count)
        self._load(values, covs)
        sensor = RANGE_BEARING if self._sensor == BEARING else self._sensor
        augment(sensor, self._state, self._point, self._cov, self._size, count, self._work)
        self._size += 2 * count
        self._index(np.concatenate([self._ids, ids]))

    def columns_of(self, ids: Int) -> Int:
        """Entries (2m,) of the state that the landmarks (m,) take up."""
        first = 3 + 2 * self.slots_of(ids)
        return np.column_stack([first, first + 1]).ravel()

    def entries(self, columns: Int) -> Float:
        """What the state holds in `columns`; 0, 1, 2 are the robot's."""
        return self._state[columns]

    def block(self, columns: Int) -> Float:
        """Covariance (c, c) of the entries in `columns` (c,)."""
        return self._cov[np.minimum.outer(columns, columns), np.maximum.outer(columns, columns)]

    def add_linear(
        self, ids: Int, values: Float, columns: Int, jacobian: Float, own_cov: Float, points: Sequence[bool]
    ) -> None:
        """Append to the state what is known of it by its Jacobian.

        Args:
            ids: (m,) as for landmarks; each takes two entries.
            values: (2m,).
            columns: (c,) of the state, on which they depend ...
            jacobian: (2m, c) ... in this way, ...
            own_cov: (2m, 2m) with noise of their own.
            points: (m,) which of them are positions in the plane (see `kernels.corrections`: these turn with the map).
        """
        first, size = self._size, self._size + len(values)
        self._reserve(size)
        self._state[first:size] = self._point[first:size] = values
        linear.append_linear(self._cov, first, columns, jacobian, own_cov)
        self._work.points[(first - 3) // 2 : (size - 3) // 2] = points
        self._size = size
        self._index(np.concatenate([self._ids, ids]))

    def correct_linear(self, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float) -> float:
        """Correct with innovations (r,) whose Jacobian (r, c) on `columns` (c,) is given; returns the NIS.

        Raises:
            ValueError: there is no update, because something is not finite or `noise_cov` not positive definite.
        """
        rows, size = len(innovation), self._size
        dx, W, S = self._work.scratch[0], np.empty((rows, size)), np.empty((rows, rows))
        nis = linear.take_in_linear(self._cov, size, columns, jacobian, innovation, noise_cov, W, S, dx)
        if not np.isfinite(nis):
            raise ValueError(f"observation: no update exists; {SOUND}")
        self._rule.retract(self._state, self._cov, size, self._work)
        return nis

    def update_one_by_one(
        self, values: Float, covs: Float, gate: float, new_gate: float, next_id: int
    ) -> tuple[Int, float, int]:
        """Associate the observations (m, d) with the nearest landmarks, correcting and mapping at once.

        New landmarks get the ids `next_id`, `next_id + 1`, ...; see `kernels.one_by_one`.

        Returns:
            Slots (m,), -1 for none; the NIS and its degrees of freedom.
        """
        count = len(values)
        self._reserve(self._size + 2 * count)
        work = self._room_for(count)
        self._load(values, covs)
        belief = (self._sensor, self._state, self._point, self._cov, self._size)
        invariant = self._rule.retract is retract_right_invariant
        nis, informative, size = update_one_by_one(*belief, count, gate, new_gate, invariant, self._rule.passes, work)
        if not np.isfinite(nis):
            raise ValueError(f"observation: no update exists for this scan; {SOUND}")
        added = (size - self._size) // 2
        self._size = size
        if added:
            self._index(np.concatenate([self._ids, np.arange(next_id, next_id + added)]))
        return work.slots[:count].copy(), nis, informative

    def compatible(self, values: Float, covs: Float, gate: float) -> tuple[Pairs, int]:
        """Pairs of an observation (m, d) and a landmark within `gate` (squared Mahalanobis), and their number.

        They are valid until the next call.
        """
        work, given = self._room_for(len(values)), len(values)
        self._load(values, covs)
        belief = (self._sensor, self._state, self._point, self._cov, self._size)
        scan = (work.observation[:given], work.observation_cov[:given])
        count = find_compatible(*belief, *scan, gate, self._pairs)
        if count < 0:
            self._pairs = allocate_pairs(-2 * count)
            count = find_compatible(*belief, *scan, gate, self._pairs)
        return self._pairs, count

    def innovations(self, slots: Int, values: Float, covs: Float) -> tuple[Float, Float]:
        """Innovations (m, d) of observations of the landmarks in `slots` (m,), and each one's covariance (m, d, d)."""
        count, first = len(slots), 2 - values.shape[1]
        work = self._room_for(count)
        work.slots[:count] = slots
        self._load(values, covs)
        S = np.empty((count, 2, 2))
        describe(self._sensor, self._state, self._point, self._cov, count, work, S)
        return work.innovation[: 2 * count].reshape(count, 2)[:, first:].copy(), S[:, first:, first:]

    def slots_of(self, ids: Int) -> Int:
        """Slots (m,) of mapped landmarks (m,)."""
        return self._sorted_slots[np.searchsorted(self._sorted_ids, ids)]

    def jointly_compatible(self, given: int, count: int, gate: float, quantiles: Float, node_limit: int) -> Int:
        """Slots of the best joint association of the first `count` pairs of `compatible`, -1 for none.

        Args:
            given: number m of the observations that `compatible` was given.
            count: how many pairs.
            gate: see `kernels.compatibility.search_jointly`, also for the others.
            quantiles: (m + 1,).
            node_limit: pairs to try.
        """
        best = np.empty(given, dtype=np.int64)
        covs = self._work.observation_cov[:given]
        search_jointly(self._cov, covs, self._pairs, count, gate, quantiles, node_limit, best)
        return best

    def ambiguous(self, count: int, gate: float, margin: float, slots: Int) -> NDArray[np.bool_]:
        """Which observations (m,) of `compatible` another association than `slots` (m,) explains nearly as well.

        See `kernels.compatibility.mark_ambiguous`.
        """
        marks = np.zeros(len(slots), dtype=np.bool_)
        covs = self._work.observation_cov[: len(slots)]
        mark_ambiguous(self._cov, covs, self._pairs, count, gate, margin, slots, marks)
        return marks

    def remove(self, slot: int) -> None:
        """Take a landmark out of the map (marginalise it); the last landmark moves into its slot."""
        map_edits.remove_landmark(self._state, self._point, self._cov, self._size, slot)
        self._size -= 2
        points, last = self._work.points, (self._size - 3) // 2
        points[slot], points[last] = points[last], True
        ids = self._ids.copy()
        ids[slot] = ids[-1]
        self._index(ids[:-1])

    def merge(self, kept: int, gone: int) -> None:
        """Take the landmarks in two slots for one, which stays in `kept`; `gone` is removed."""
        work = self._room_for(1)
        if map_edits.equate_landmarks(self._state, self._cov, self._size, kept, gone, work):
            self._rule.retract(self._state, self._cov, self._size, work)
        self.remove(gone)

    def find_duplicate(self, slots: Int, apart: NDArray[np.bool_], gate: float, distance: float) -> tuple[int, int]:
        """Slots of two landmarks that are statistically one; see `kernels.map_edits.find_duplicate`."""
        return map_edits.find_duplicate(self._state, self._cov, self._size, slots, apart, gate, distance)

    def _index(self, ids: Int) -> None:
        """Note the ids in slot order, and sorted for the search by `find_slots`."""
        self._ids = ids
        self._sorted_slots = np.argsort(ids)
        self._sorted_ids = ids[self._sorted_slots]

    def _reserve(self, size: int) -> None:
        """Make room for `size` state entries; untouched pages of the larger array cost no memory."""
        if size <= len(self._state):
            return
        capacity = 2 * size
        used, more = self._size, capacity - self._size
        self._state = np.pad(self._state[:used], (0, more))
        self._point = np.pad(self._point[:used], (0, more)) if self._rule.first_estimates else self._state
        cov = np.zeros((capacity, capacity))
        cov[:used, :used] = self._cov[:used, :used]
        self._cov = cov
        self._renew_workspace(len(self._work.ids))
