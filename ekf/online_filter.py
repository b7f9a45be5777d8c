"""What all online filters have in common, and those among them of which every landmark is a point."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.maps.members import Members, points
from slamgauge.estimate import RayLog
from slamgauge.recording import Observations


class OnlineFilter(Protocol):
    """A filter that is driven step by step: `predict`, then `update` with what the sensor has seen."""

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
        """(m,) id that each observation of the current step was given, -1 if none."""
        ...

    @property
    def member_count(self) -> int:
        """How many members those landmarks have that are no points yet."""
        ...

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        ...

    def update(self, observations: Observations) -> tuple[float, int]:
        """Take in the observations of one step; returns the NIS and its degrees of freedom."""
        ...

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: the landmark's id now, -1 if it is none."""
        ...

    def whole_map(self) -> Members:
        """Every point, and every member of landmarks that are no points yet."""
        ...

    def ray_log(self, members: Int) -> RayLog | None:
        """What became of rays, with the number of members (N+1,) after each step; None without rays."""
        ...


class PointFilter(OnlineFilter, Protocol):
    """An online filter of which every landmark is a point: there are no rays, and no members.

    What ids become is what it is with known association: they are the user's own, and stay.
    """

    @property
    def member_count(self) -> int:
        """No landmark has members."""
        return 0

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: they stay."""
        return ids

    def whole_map(self) -> Members:
        """Every landmark is a point."""
        return points(self.landmark_ids, self.landmarks, self.landmark_covs)

    def ray_log(self, members: Int) -> RayLog | None:  # noqa: ARG002
        """None: there are no rays."""
        return None
