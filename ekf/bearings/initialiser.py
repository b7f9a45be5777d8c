"""What all initialisations of bearing-only landmarks share: they keep the landmarks that are not points yet."""

from __future__ import annotations

from typing import Protocol

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.ray_recorder import RayRecorder
from slamgauge.ekf.maps.members import Members


class Initialiser(Protocol):
    """Provisional landmarks: those of a `BearingFilter` from their first bearing until they are points."""

    @property
    def counts(self) -> dict[int, int]:
        """The provisional landmarks, in the order of their first bearings, and how many members each has."""
        ...

    @property
    def log(self) -> RayRecorder | None:
        """What has become of the rays; None without rays."""
        ...

    def observe(self, step: int, ids: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Take in the bearings (m, 1), with covariances (m, 1, 1), of provisional and new landmarks `ids` (m,).

        Returns:
            The landmarks that became points, and the id of each in the `LandmarkMap`.
        """
        ...

    def members(self) -> Members:
        """Where the landmarks may be; those whose position cannot be stated have no row."""
        ...

    def member_ids(self) -> dict[int, Int]:
        """Ids in the `LandmarkMap` of the members, landmark by landmark, that a bearing can be compared with."""
        ...

    def forget(self, step: int, landmark: int) -> None:
        """Take a provisional landmark out of the state."""
        ...
