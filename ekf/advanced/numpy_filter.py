"""The common online form of filters that are written in numpy.

A `MovingBelief` contains the filter's state, covariance and steps. `NumpyFilter` checks the input, finds the slots of
the ids, and calls these steps. Their linear algebra is in `dense_algebra`.
"""

from __future__ import annotations

import copy
from collections.abc import Collection
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.prediction import is_semidefinite
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LARGEST
from slamgauge.ekf.kernels.warm_up import compile_numpy_filters_once
from slamgauge.ekf.maps.input_checks import (
    explain_increment,
    explain_scan,
    ids_of,
    load_increment,
    require_ids,
    require_sensor,
    rows_of,
)
from slamgauge.ekf.maps.landmark_ids import of_scan
from slamgauge.ekf.online_filter import PointFilter
from slamgauge.recording import Observations
from slamgauge.sensors import PLACING, SENSORS


class MovingBelief(Protocol):
    """State and covariance of robot and landmarks, with prediction, correction and augmentation.

    `correct` and `add` replace the arrays and never write into them, so that a shallow copy of the belief is a backup.
    """

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        ...

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        ...

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m] in the world frame."""
        ...

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2]."""
        ...

    @property
    def cov(self) -> Float:
        """(n, n) covariance of the state, in the belief's coordinates."""
        ...

    def move(self, increment: Float, cov: Float) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        ...

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, 2) of the landmarks in slots (m,); return the NIS and its dof."""
        ...

    def add(self, values: Float, covs: Float) -> None:
        """Map the landmarks of observations (k, 2) with covariances (k, 2, 2), in the next slots."""
        ...


class NumpyFilter(PointFilter):
    """Landmark SLAM with known association and any `MovingBelief`; steps have the form of `SlamFilter`.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        belief: belief at the start.

    Attributes:
        belief: present belief.

    Raises:
        UserError: an invalid sensor.
    """

    def __init__(self, sensor: str, belief: MovingBelief) -> None:
        require_sensor(sensor, PLACING)
        compile_numpy_filters_once()
        self._sensor = sensor
        self.belief = belief
        self._slot_of: dict[int, int] = {}
        self._increment, self._increment_cov = np.empty(3), np.empty((3, 3))
        self._associated: Int = np.zeros(0, np.int64)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self.belief.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.belief.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks in the order of their first observation."""
        return np.array([*self._slot_of], dtype=np.int64)

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m] in the world frame."""
        return self.belief.landmarks

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2]."""
        return self.belief.landmark_covs

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations."""
        return self._associated

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: invalid shapes, numbers that are not finite, or an invalid covariance; the filter is unchanged.
        """
        move, move_cov = self._increment, self._increment_cov
        load_increment(increment, cov, move, move_cov)
        is_valid = np.abs(move).max() < LARGEST and np.abs(move_cov).max() < LARGEST**2
        if not (is_valid and is_semidefinite(move_cov)):
            raise explain_increment(move, move_cov)
        self.belief.move(move, move_cov)
        self._associated = np.zeros(0, np.int64)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Correct with all observations of one step, then map the new landmarks.

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without mapped landmarks).

        Raises:
            UserError: no ids, invalid shapes, a negative range, a number that is not finite, a covariance that is not
                positive definite, or no update in double precision; the filter is then unchanged.
        """
        given, given_covs = rows_of(observations, SENSORS[self._sensor].dim)
        values, covs = np.array(given, np.float64), np.array(given_covs, np.float64)
        ids = ids_of(observations, len(values))
        require_ids(ids)
        belief, slot_of = copy.copy(self.belief), self._slot_of
        if not are_sound(SENSORS[self._sensor].code, values, covs):
            raise explain_scan(self._sensor, values, covs, np.nan, np.diagonal(belief.cov))
        try:
            nis, dof = 0.0, 0
            for rows, is_new in _in_turn(ids, slot_of):
                if is_new:
                    belief.add(values[rows], covs[rows])
                    slot_of = slot_of | {each: len(slot_of) + k for k, each in enumerate(ids[rows].tolist())}
                else:
                    slots = np.array([slot_of[each] for each in ids[rows].tolist()])
                    more, informative = belief.correct(slots, values[rows], covs[rows])
                    nis, dof = nis + more, dof + informative
        except np.linalg.LinAlgError:
            raise explain_scan(self._sensor, values, covs, EXHAUSTED, np.diagonal(belief.cov)) from None
        if not (np.isfinite(nis) and np.isfinite(np.diagonal(belief.cov)).all()):
            raise explain_scan(self._sensor, values, covs, nis, np.diagonal(belief.cov))
        self.belief, self._slot_of, self._associated = belief, slot_of, ids.copy()
        return nis, dof


def _in_turn(ids: Int, known: Collection[int]) -> list[tuple[Marks, bool]]:
    """Return the parts of a scan as masks (m,) in processing order, and whether each part maps new landmarks.

    The parts are observations of mapped landmarks, first observations of new landmarks, and their re-observations.
    """
    if known and all(each in known for each in ids.tolist()):
        return [(np.ones(len(ids), dtype=np.bool_), False)] if len(ids) else []
    mapped, new, again = of_scan(ids, np.array([*known], dtype=np.int64))
    return [(rows, is_new) for rows, is_new in ((mapped, False), (new, True), (again, False)) if rows.any()]
