"""State of a map: the belief of a filter, and the place of each landmark in it.

A slot is the place of a landmark in the state, counted from 0. Callers name landmarks by their ids: their own, or ids
from `take_ids`. Removal moves the last landmark into the freed slot.

Positions in the belief are relative to `origin`, the robot's prior position, so that they lose no digits far from the
world's origin. `pose` and `positions` are in the world frame.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT, Belief, allocate_belief, enlarged
from slamgauge.ekf.maps.correction_table import Rule
from slamgauge.ekf.maps.input_checks import start_of
from slamgauge.memory import require_memory
from slamgauge.validation import LARGEST, as_whole


class NewEntries(NamedTuple):
    """New state entries, two for each landmark: a linear function J x + noise of entries x of the state."""

    values: Float  # (2m,) positions relative to `MapState.origin`
    columns: Int  # (c,) entries x
    jacobian: Float  # (2m, c) J
    noise_cov: Float  # (2m, 2m)
    points: Sequence[bool]  # (m,) whether they are positions, which rotate with the map (see `kernels.update`)


class MapState:
    """Robot and landmarks, without prediction and update.

    Args:
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        rule: kernels of a step.
        landmarks: initial capacity; the state grows as needed.

    Attributes:
        origin: (2,) origin of the belief's positions [m] in the world frame.
        belief: state and covariance.
        ids: (L,) landmarks in the order of slots.
        ids_taken: number of ids that `take_ids` has returned.
        sorted_ids: (L,) the same, sorted.
        sorted_slots: (L,) slots in the order of `sorted_ids`.

    Raises:
        UserError: an invalid prior, or an invalid number of landmarks.
    """

    def __init__(self, prior_mean: ArrayLike, prior_cov: ArrayLike, rule: Rule, landmarks: int) -> None:
        self.origin, start, cov = start_of(prior_mean, prior_cov)
        room = as_whole("landmarks", landmarks, "is not a number of landmarks", 0)
        self.belief: Belief = allocate_belief(room, first_estimates=rule.first_estimates, form=rule.jacobians)
        self.belief.state[:3] = self.belief.point[:3] = start
        self.belief.cov[:3, :3] = cov
        self._set_ids(np.zeros(0, dtype=np.int64))
        self.ids_taken = 0

    @property
    def size(self) -> int:
        """Number of state entries: 3 + 2L."""
        return self.belief.size

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        pose = self.robot
        pose[:2] += self.origin
        return pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.belief.cov[:3, :3].copy()

    @property
    def robot(self) -> Float:
        """(3,) pose relative to `origin`."""
        return self.belief.state[:3].copy()

    @property
    def positions(self) -> Float:
        """(L, 2) positions of the landmarks [m] in the world frame, in the order of slots."""
        return self.belief.state[3 : self.size].reshape(-1, 2) + self.origin

    @property
    def position_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        cov, first = self.belief.cov, np.arange(3, self.size, 2)
        xx, xy, yy = cov[first, first], cov[first, first + 1], cov[first + 1, first + 1]
        return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of robot and landmarks in the order of slots."""
        upper = np.triu(self.belief.cov[: self.size, : self.size])
        return upper + np.triu(upper, 1).T

    @property
    def variances(self) -> Float:
        """(3 + 2L,) variances of all entries."""
        return np.diagonal(self.belief.cov)[: self.size]

    def slots_of(self, ids: ArrayLike) -> Int:
        """Return the slots (m,) of mapped landmarks (m,)."""
        return self.sorted_slots[np.searchsorted(self.sorted_ids, ids)]

    def columns_of(self, ids: Int) -> Int:
        """Return the state entries (2m,) of the landmarks (m,)."""
        first = 3 + 2 * self.slots_of(ids)
        return np.column_stack([first, first + 1]).ravel()

    def entries(self, columns: Int) -> Float:
        """Return the state entries `columns` (c,), positions relative to `origin`; 0, 1, 2 are the robot's."""
        return self.belief.state[columns]

    def covariances(self, columns: Int, others: Int | None = None) -> Float:
        """Return the covariance (c, k) of state entries `columns` (c,) and `others` (k,), by default all."""
        others = np.arange(self.size) if others is None else others
        return self.belief.cov[np.minimum.outer(columns, others), np.maximum.outer(columns, others)]

    def add_entries(self, ids: Int, new: NewEntries) -> None:
        """Append entries for `ids` (m,) to the state."""
        first, last = self.size, self.size + len(new.values)
        across = new.jacobian @ self.covariances(new.columns)
        self.reserve(last)
        self.belief.state[first:last] = self.belief.point[first:last] = new.values
        self.belief.cov[:first, first:last] = across.T
        self.belief.cov[first:last, first:last] = across[:, new.columns] @ new.jacobian.T + new.noise_cov
        self.belief.points[(first - ROBOT) // 2 : (last - ROBOT) // 2] = new.points
        self.append(ids)

    def take_ids(self, count: int) -> Int:
        """Return the next `count` of the ids 0, 1, 2, ...; each is returned once."""
        self.ids_taken += count
        return np.arange(self.ids_taken - count, self.ids_taken)

    def take_hidden_ids(self, count: int) -> Int:
        """Return `count` ids for entries other than landmarks: -2, -3, ...; each is returned once."""
        return -2 - self.take_ids(count)

    def rename(self, old: int, new: int) -> None:
        """Give another id to a landmark."""
        self._set_ids(np.where(self.ids == old, new, self.ids))

    def append(self, ids: Int) -> None:
        """Give ids (m,) to the entries behind the state that a kernel has filled."""
        self.belief = self.belief._replace(size=self.size + 2 * len(ids))
        self._set_ids(np.concatenate([self.ids, ids]))

    def remove(self, *removed: int) -> None:
        """Remove landmarks (marginalise them)."""
        ids, (state, point, cov, points, size, _) = self.ids.copy(), self.belief
        for slot in sorted(self.slots_of(removed).tolist(), reverse=True):
            to, last = 3 + 2 * slot, size - 2  # the last landmark moves into the slot
            for array in (state, point):
                array[to : to + 2] = array[last:size]
            cov[:to, to : to + 2] = cov[:to, last:size]
            cov[to : to + 2, to + 2 : last] = cov[to + 2 : last, last:size].T
            cov[to : to + 2, to : to + 2] = cov[last:size, last:size]
            points[slot], points[(last - 3) // 2] = points[(last - 3) // 2], True
            ids[slot], size = ids[(last - 3) // 2], last
        self.belief = self.belief._replace(size=size)
        self._set_ids(ids[: len(ids) - len(removed)])

    def _set_ids(self, ids: Int) -> None:
        self.ids: Int = np.ascontiguousarray(ids, dtype=np.int64)  # `find_slots` is compiled for this type
        self.sorted_slots: Int = np.argsort(self.ids)
        self.sorted_ids: Int = self.ids[self.sorted_slots]

    def reserve(self, size: int) -> None:
        """Enlarge the arrays to `size` entries if necessary.

        Raises:
            UserError: there is not enough memory; nothing has changed.
        """
        if size > len(self.belief.state):
            what = f"the covariance of {(size - ROBOT) // 2} landmarks or members of rays"
            require_memory(8.0 * size * size, what, "give fewer landmarks, or choose a larger beta of rays")
            self.belief = enlarged(self.belief, size)

    @contextmanager
    def transaction(self, *, only_addition: bool = False) -> Generator[None]:
        """Restore the map if the body of the `with` statement raises.

        Args:
            only_addition: whether nothing is refused after P has changed, except the addition of landmarks. Then P is
                copied only if an addition may be refused; a copy costs time on large maps.
        """
        belief, ids, taken = self.belief, self.ids, self.ids_taken
        size = belief.size
        is_certain = only_addition and self.variances.max() < LARGEST**2  # landmarks have finite covariances
        kept = 0 if is_certain else size
        entries, point, cov = belief.state[:size].copy(), belief.point[:size].copy(), belief.cov[:kept, :kept].copy()
        points = belief.points.copy()
        try:
            yield
        except BaseException:
            belief.state[:size], belief.point[:size], belief.cov[:kept, :kept] = entries, point, cov
            belief.points[:] = points
            self.belief, self.ids_taken = belief, taken
            self._set_ids(ids)
            raise
