"""The base of the online filters, and tables of points and members."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.estimate import RayLog
from slamgauge.notices import tell_once
from slamgauge.recording import Observations

LOST = 1e4  # NIS divided by its degrees of freedom; noise that is too small for the linearisation gives such values


class Members(NamedTuple):
    """A row for every point, and for every member of a ray."""

    landmark: Int  # (k,) id
    number: Int  # (k,) along the ray, from 0; NONE for a point
    weight: Float  # (k,) probability
    position: Float  # (k, 2) [m]
    cov: Float  # (k, 2, 2) [m^2]


def points(landmark: Int, position: Float, cov: Float) -> Members:
    """Return rows for points (k,) at positions (k, 2) with covariances (k, 2, 2)."""
    return Members(landmark, np.full(len(landmark), NONE), np.ones(len(landmark)), position, cov)


def joined(parts: Sequence[Members]) -> Members:
    """Return the rows of all parts."""
    return Members(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


NO_MEMBERS = points(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))


class OnlineFilter(ABC):
    """A filter that a robot calls at every step: `predict`, then `update` with the observations.

    Args:
        landmarks: the map, which `predict` and `update` change.

    Attributes:
        map: robot and landmarks (see `maps.landmark_map`), for estimators and tests.
    """

    def __init__(self, landmarks: LandmarkMap) -> None:
        self.map = landmarks
        self._associated: Int = np.zeros(0, dtype=np.int64)
        self._nis, self._dof = 0.0, 0

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self.map.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.map.pose_cov

    @property
    def cov(self) -> Float:
        """(3 + 2n, 3 + 2n) covariance of the whole state: the robot, then all entries of the map."""
        return self.map.cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks: in the order of their first observation, unless some were removed."""
        return self.map.ids.copy()

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self.map.positions

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self.map.position_covs

    @property
    def associated(self) -> Int:
        """(m,) landmark of each observation of the current step, -1 without one."""
        return self._associated

    @property
    def member_count(self) -> int:
        """Number of members of all rays."""
        return 0

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        The increment of speed v and yaw rate omega over dt is (v dt, 0, omega dt).

        Raises:
            UserError: wrong shapes, a number that is not finite, or an invalid covariance; the filter is unchanged.
        """
        self.map.predict(increment, cov)
        self._associated = self._associated[:0]

    @abstractmethod
    def update(self, observations: Observations) -> tuple[float, int]:
        """Process the observations of one step; return the NIS and its degrees of freedom."""

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids, -1 for deleted landmarks."""
        return ids

    def whole_map(self) -> Members:
        """Return every point, and every member of every ray."""
        return points(self.landmark_ids, self.landmarks, self.landmark_covs)

    def ray_log(self, members: Int) -> RayLog | None:  # noqa: ARG002 only bearing-only filters have rays
        """Return the log of the rays; None without rays."""
        return None

    def _finished(self, associated: Int, nis: float, dof: int) -> tuple[float, int]:
        """Store the association (m,) of a step; return its NIS and degrees of freedom.

        If their sums show that the filter has diverged, a notice is printed, once.
        """
        self._associated = associated
        self._nis, self._dof = self._nis + nis, self._dof + dof
        if self._nis > LOST * max(1, self._dof):
            name = self.map.rule.estimator
            tell_once(f"{name} has diverged: its NIS is over {LOST:g} times its degrees of freedom; raise sensor noise")
        return nis, dof
