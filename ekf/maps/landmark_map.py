"""The belief of a filter and its book-keeping: ids, slots, growth, and what changes them.

A slot is the place of a landmark in the state, counted from 0, and a row of `positions`. It stays the landmark's own
until `remove` or `merge`. Whoever adds landmarks gives them their ids.

Positions of the belief are relative to where the prior puts the robot, `origin`, so that they keep their digits
wherever in the world that is. `pose` and `positions` are in the world frame, and so is what `replace` takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels import linear_update, map_edits
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.belief import ROBOT, Belief, allocate_belief, enlarged
from slamgauge.ekf.kernels.deferred_downdate import allocate_waiting, settle
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.student_t_weights import weigh
from slamgauge.ekf.kernels.warm_up import compile_once
from slamgauge.ekf.kernels.workspace import CORRECTION, Workspace, allocate
from slamgauge.ekf.maps.correction_table import Correction, Rule, rule_of
from slamgauge.ekf.maps.input_checks import (
    DIVERGED,
    explain_increment,
    explain_scan,
    load_increment,
    require_room,
    require_sensor,
    start_of,
    why_not,
)
from slamgauge.errors import UserError
from slamgauge.jit import direct
from slamgauge.memory import require_memory
from slamgauge.sensors import SENSORS


class LandmarkMap:
    """Robot and landmarks, and how they are corrected.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: name or rule; see `rules`.
        landmarks: how many to make room for at first; the map grows beyond that by itself.
        tails: degrees of freedom of the observations' noise (see `kernels.student_t_weights`).

    Attributes:
        origin: (2,) of the belief's positions [m] in the world frame.
        unsettled: the belief, for who reads no landmarks' covariances with each other; these may wait (see
            `kernels.deferred_downdate`).

    Raises:
        UserError: a sensor or correction that does not exist, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction | Rule,
        landmarks: int,
        tails: float = math.inf,
    ) -> None:
        require_sensor(sensor, tuple(SENSORS))
        self.rule = rule_of(correction)
        self.origin, start, cov = start_of(prior_mean, prior_cov)
        room = require_room(landmarks)
        compile_once()
        self.sensor = sensor
        self.tails = tails
        self.code, self.dim = SENSORS[sensor].code, SENSORS[sensor].dim
        rule = self.rule
        self.unsettled: Belief = allocate_belief(room, first_estimates=rule.first_estimates, form=rule.form)
        self.unsettled.state[:3] = self.unsettled.point[:3] = start
        self.unsettled.cov[:3, :3] = cov
        self.ids: Int = np.zeros(0, dtype=np.int64)  # in the order of slots
        self._sorted_ids: Int = self.ids
        self._sorted_slots: Int = self.ids
        self._increment = np.zeros(3)
        self._increment_cov = np.zeros((3, 3))
        self._allocate(0)
        self._compile()

    def _allocate(self, observations: int) -> None:
        """A workspace for states as large as there is room for; nothing waits."""
        capacity = len(self.unsettled.state)
        waiting = allocate_waiting(*self.rule.waiting, capacity)
        self._work = allocate(observations, capacity, self.rule.block, waiting)

    def _compile(self) -> None:
        """Machine code of a step, for the types of these arrays."""
        rule = self.rule
        self._predict = direct(rule.predict, self.unsettled, self._increment, self._increment_cov)
        self._find_slots = direct(rule.find_slots, self.ids, self.ids, self._work.ids, self._work.slots)
        self._update = direct(rule.update, self.code, self.unsettled, 0, self._work)

    def __getstate__(self) -> dict[str, object]:
        """All but the machine code, which is of this process."""
        return {key: value for key, value in vars(self).items() if key not in ("_predict", "_find_slots", "_update")}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._compile()

    # --- what is believed ------------------------------------------------------------------------

    @property
    def belief(self) -> Belief:
        """All of it, settled: a pass over the covariance where updates wait."""
        settle(self.unsettled.cov, self.unsettled.size, self._work.waiting)
        return self.unsettled

    @belief.setter
    def belief(self, belief: Belief) -> None:
        self.unsettled = belief
        self._work.waiting.used[0] = 0

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        pose = self.unsettled.state[:3].copy()
        pose[:2] += self.origin
        return pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.unsettled.cov[:3, :3].copy()

    @property
    def positions(self) -> Float:
        """(L, 2) of the landmarks [m] in the world frame, in the order of slots."""
        return self.unsettled.state[3 : self.unsettled.size].reshape(-1, 2) + self.origin

    @property
    def position_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        cov, first = self.unsettled.cov, np.arange(3, self.unsettled.size, 2)
        xx, xy, yy = cov[first, first], cov[first, first + 1], cov[first + 1, first + 1]
        return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of robot and landmarks in the order of slots."""
        upper = np.triu(self.belief.cov[: self.belief.size, : self.belief.size])
        return upper + np.triu(upper, 1).T

    @property
    def variances(self) -> Float:
        """(3 + 2L,) of all entries."""
        return np.diagonal(self.unsettled.cov)[: self.unsettled.size]

    def slots_of(self, ids: Int) -> Int:
        """Slots (m,) of mapped landmarks (m,)."""
        return self._sorted_slots[np.searchsorted(self._sorted_ids, ids)]

    def columns_of(self, ids: Int) -> Int:
        """Entries (2m,) of the state that the landmarks (m,) take up."""
        first = 3 + 2 * self.slots_of(ids)
        return np.column_stack([first, first + 1]).ravel()

    def entries(self, columns: Int) -> Float:
        """What the state holds in `columns`, positions relative to `origin`; 0, 1, 2 are the robot's."""
        return self.unsettled.state[columns]

    @property
    def robot(self) -> Float:
        """(3,) the robot's entries: its pose relative to `origin`."""
        return self.unsettled.state[:3].copy()

    def block(self, columns: Int) -> Float:
        """Covariance (c, c) of the entries in `columns` (c,)."""
        return self.belief.cov[np.minimum.outer(columns, columns), np.maximum.outer(columns, columns)]

    # --- steps -----------------------------------------------------------------------------------

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: shapes that do not fit, a number that is not finite, or no covariance; nothing has changed.
        """
        load_increment(increment, cov, self._increment, self._increment_cov)
        if not self._predict(self.unsettled, self._increment, self._increment_cov):
            raise explain_increment(self._increment, self._increment_cov)

    def require_sound(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> None:
        """Refuse observations (m, d), (m, d, d) that a `Recording` could not have; nothing has changed."""
        work = self.room_for(len(values))
        self.load(values, covs)
        if not are_sound(self.code, work.observation[: len(values)], work.observation_cov[: len(values)]):
            raise explain_scan(self.sensor, values, covs, math.nan, self.variances)

    def find(self, ids: ArrayLike, count: int) -> bool:
        """Look up the slots of `count` landmarks for `correct_found`; False if one is not mapped."""
        work = self.room_for(count)
        work.ids[:count] = ids
        return not self._find_slots(self._sorted_ids, self._sorted_slots, work.ids[:count], work.slots)

    def correct_found(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> tuple[float, int]:
        """Correct with observations (m, d), (m, d, d) of the landmarks that `find` has found; returns as `correct`."""
        self.load(values, covs)
        if self.tails < math.inf:
            weigh(self.code, self.unsettled, len(values), self._work, np.empty((len(values), 2, 2)), self.tails)
        nis, informative = self._update(self.code, self.unsettled, len(values), self._work)
        if not math.isfinite(nis):
            raise explain_scan(self.sensor, values, covs, nis, self.variances)
        return nis, informative

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, d), (m, d, d) of the landmarks in `slots` (m,).

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without observations).

        Raises:
            UserError: there is no update; nothing has changed.
        """
        count = len(slots)
        if count == 0:
            return 0.0, 0
        self.room_for(count).slots[:count] = slots
        return self.correct_found(values, covs)

    def correct_linear(self, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float) -> float:
        """Correct with innovations (r,) whose Jacobian (r, c) on `columns` (c,) is given; returns the NIS.

        Raises:
            UserError: there is no update, because something is not finite or `noise_cov` not positive definite.
        """
        rows = len(innovation)
        room = linear_update.Room(
            np.empty((rows, self.belief.size)), np.empty((rows, rows)), self._work.scratch[CORRECTION]
        )
        nis = linear_update.take_in_linear(self.belief, columns, jacobian, innovation, noise_cov, room)
        if not np.isfinite(nis):
            remedy = "make every value finite and every covariance positive definite"
            raise UserError(f"observation: no update exists; {remedy}; {why_not(nis, self.variances)}")
        self.rule.retract(self.belief, self._work)
        return nis

    # --- which landmarks there are ---------------------------------------------------------------

    def replace(self, ids: Int, positions: Float, cov: Float) -> None:
        """Replace the map: ids (L,), positions (L, 2), and the covariance (3 + 2L, 3 + 2L) with the robot first."""
        size = 3 + 2 * len(ids)
        self.reserve(size)
        self.resize(size)
        self.belief.state[3:size] = self.belief.point[3:size] = np.ravel(positions - self.origin)
        self.belief.cov[:size, :size] = cov
        self.belief.points[:] = True
        self.name(ids)

    def add(self, ids: Int, values: Float, covs: Float) -> None:
        """Map new landmarks (m,) at their first observations (m, 2), with covariances (m, 2, 2).

        With a bearing sensor these are made up of a range and a bearing.

        Raises:
            UserError: they have no finite positions or covariances; nothing has changed.
        """
        count = len(ids)
        self.reserve(self.unsettled.size + 2 * count)
        self.room_for(count)
        self.load(values, covs)
        augment(self.code, self.unsettled, count, self._work)
        first, last = self.unsettled.size, self.unsettled.size + 2 * count
        added = (self.unsettled.state[first:last], np.diagonal(self.unsettled.cov)[first:last])
        if not all(np.isfinite(each).all() for each in added):
            raise UserError(f"observation: no finite landmarks follow from this scan; {DIVERGED}")
        self.resize(last)
        self.name(np.concatenate([self.ids, ids]))

    def add_linear(
        self, ids: Int, values: Float, columns: Int, jacobian: Float, own_cov: Float, points: Sequence[bool]
    ) -> None:
        """Append entries J x + noise to the state, where x are some of its entries.

        Args:
            ids: (m,) as for landmarks; each takes two entries.
            values: (2m,) of the new entries, positions relative to `origin`.
            columns: (c,) of the entries x.
            jacobian: (2m, c) J.
            own_cov: (2m, 2m) covariance of the noise.
            points: (m,) which are positions in the plane (see `kernels.corrections`: these turn with the map).
        """
        first, size = self.belief.size, self.belief.size + len(values)
        self.reserve(size)
        self.belief.state[first:size] = self.belief.point[first:size] = values
        linear_update.append_linear(self.belief, columns, jacobian, own_cov)
        self.belief.points[(first - 3) // 2 : (size - 3) // 2] = points
        self.resize(size)
        self.name(np.concatenate([self.ids, ids]))

    def remove(self, slot: int) -> None:
        """Take a landmark out of the map (marginalise it); the last landmark moves into its slot."""
        map_edits.remove_landmark(self.belief, slot)
        self.resize(self.belief.size - 2)
        ids = self.ids.copy()
        ids[slot] = ids[-1]
        self.name(ids[:-1])

    def merge(self, kept: int, gone: int) -> None:
        """Take the landmarks in two slots for one, which stays in `kept`; `gone` is removed."""
        work = self.room_for(1)
        if map_edits.equate_landmarks(self.belief, kept, gone, work):
            self.rule.retract(self.belief, work)
        self.remove(gone)

    def find_duplicates(self, slots: Int, apart: Marks, gate: float) -> Int:
        """Slots (p, 2) of landmarks that are statistically one; see `kernels.map_edits.find_duplicates`."""
        return map_edits.find_duplicates(self.belief, slots, apart, gate)

    def robot_if_one(self, pairs: Int) -> tuple[Float, Float]:
        """Pose (3,) and covariance (3, 3) if the landmarks in the slots of `pairs` (p, 2) are one each; see `merge`."""
        belief, (slots, places) = self.belief, np.unique(pairs, return_inverse=True)
        columns = np.concatenate([np.arange(ROBOT), (ROBOT + 2 * slots[:, None] + [0, 1]).ravel()])
        state = belief.state[columns]
        point = state if belief.point is belief.state else belief.point[columns]
        points = belief.points[slots]
        concerned = Belief(state, point, self.block(columns), points, len(columns), belief.form)
        work = allocate(1, len(columns), self.rule.block)
        for a, b in places.reshape(-1, 2).tolist():
            if map_edits.equate_landmarks(concerned, a, b, work):
                self.rule.retract(concerned, work)
        pose = state[:3].copy()
        pose[:2] += self.origin
        return pose, concerned.cov[:3, :3].copy()

    # --- for the modules of this room ------------------------------------------------------------

    def name(self, ids: Int) -> None:
        """Note the ids in the order of slots, and sorted for `find`."""
        self.ids = np.ascontiguousarray(ids, dtype=np.int64)  # what the kernel that looks them up is compiled for
        self._sorted_slots = np.argsort(self.ids)
        self._sorted_ids = self.ids[self._sorted_slots]

    def resize(self, size: int) -> None:
        """Note how many entries are in use."""
        self.unsettled = self.unsettled._replace(size=size)

    def reserve(self, size: int) -> None:
        """Make room for `size` entries.

        Raises:
            UserError: memory does not hold them; nothing has changed.
        """
        if size > len(self.unsettled.state):
            what = f"the covariance of {(size - ROBOT) // 2} landmarks or members of rays"
            require_memory(8.0 * size * size, what, "give fewer landmarks, or choose a larger beta of rays")
            self.unsettled = enlarged(self.belief, size)
            self._allocate(len(self._work.ids))

    def room_for(self, observations: int) -> Workspace:
        """The workspace, with room for that many observations."""
        if observations > len(self._work.ids):
            self._work = allocate(observations, len(self.unsettled.state), self.rule.block, self._work.waiting)
        return self._work

    def load(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> None:
        """Put observations (m, d), (m, d, d) into the workspace; a bearing alone is the second of its two rows."""
        count, work = len(values), self._work
        if values.shape[1] == 2:
            work.observation[:count] = values
            work.observation_cov[:count] = covs
        else:
            work.observation_cov[:count] = np.eye(2)
            work.observation[:count, 1:] = values
            work.observation_cov[:count, 1:, 1:] = covs
