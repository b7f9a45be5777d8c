"""Interface of the online filters, and its defaults for filters without rays."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.maps.members import Members, points
from slamgauge.estimate import RayLog
from slamgauge.recording import Observations


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
