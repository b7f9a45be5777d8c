"""Interface of the online filters, its defaults for filters without rays, and tables of points and members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.estimate import RayLog
from slamgauge.recording import Observations

POINT = -1  # number of a landmark without members


class Members(NamedTuple):
    """A row for every point, and for every member of a ray."""

    landmark: Int  # (k,) id
    number: Int  # (k,) along the ray, from 0; POINT for a point
    weight: Float  # (k,) probability
    position: Float  # (k, 2) [m]
    cov: Float  # (k, 2, 2) [m^2]


def points(landmark: Int, position: Float, cov: Float) -> Members:
    """Return rows for points (k,) at positions (k, 2) with covariances (k, 2, 2)."""
    return Members(landmark, np.full(len(landmark), POINT), np.ones(len(landmark)), position, cov)


def joined(parts: Sequence[Members]) -> Members:
    """Return the rows of all parts."""
    return Members(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


NO_MEMBERS = points(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))


class OnlineFilter(Protocol):
    """A filter that a robot calls at every step: `predict`, then `update` with the observations."""

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        ...

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        ...

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks."""
        ...

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        ...

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        ...

    @property
    def associated(self) -> Int:
        """(m,) landmark of each observation of the current step, -1 without one."""
        ...

    @property
    def member_count(self) -> int:
        """Number of members of all rays."""
        ...

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        ...

    def update(self, observations: Observations) -> tuple[float, int]:
        """Process the observations of one step; return the NIS and its degrees of freedom."""
        ...

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids, -1 for deleted landmarks."""
        ...

    def whole_map(self) -> Members:
        """Return every point, and every member of every ray."""
        ...

    def ray_log(self, members: Int) -> RayLog | None:
        """Return the log of rays, with the number of members (N+1,) after each step; None without rays."""
        ...


class PointFilter(OnlineFilter, Protocol):
    """An online filter without rays, by default with known association: ids stay the same."""

    @property
    def member_count(self) -> int:
        """0: no landmark has members."""
        return 0

    def standing(self, ids: Int) -> Int:
        """Return the ids unchanged."""
        return ids

    def whole_map(self) -> Members:
        """Return all landmarks as points."""
        return points(self.landmark_ids, self.landmarks, self.landmark_covs)

    def ray_log(self, members: Int) -> RayLog | None:  # noqa: ARG002
        """Return None."""
        return None
