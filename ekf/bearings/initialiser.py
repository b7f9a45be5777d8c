"""Interface of the initialisations of bearing-only landmarks, and the log of rays."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.online_filter import Members
from slamgauge.estimate import RayLog


class RayRecorder:
    """Logs start and end of rays."""

    def __init__(self) -> None:
        self._landmark: list[int] = []
        self._birth: list[int] = []
        self._distances: list[Float] = []
        self._end: list[int] = []
        self._survivor: list[int] = []
        self._open: dict[int, int] = {}  # landmark to row of its present ray

    def begin(self, step: int, landmark: int, distances: Float) -> None:
        """Log a new ray with members at these distances [m]."""
        self._open[landmark] = len(self._landmark)
        self._landmark.append(landmark)
        self._birth.append(step)
        self._distances.append(distances)
        self._end.append(-1)
        self._survivor.append(-1)

    def end(self, step: int, landmark: int, survivor: int = -1) -> None:
        """Log that a ray became a point, the member `survivor`, or was deleted (-1)."""
        row = self._open.pop(landmark)
        self._end[row], self._survivor[row] = step, survivor

    def log(self, members: Int) -> RayLog:
        """Return the rays so far, with the number of members (N+1,) after each step."""
        distances = np.full((len(self._landmark), max(map(len, self._distances), default=0)), np.nan)
        for row, given in enumerate(self._distances):
            distances[row, : len(given)] = given
        columns = (self._landmark, self._birth, self._end, self._survivor)
        landmark, birth, end, survivor = (np.array(column, dtype=np.int64) for column in columns)
        return RayLog(landmark, birth, end, survivor, distances, members)


class Initialiser(Protocol):
    """Provisional landmarks of a `BearingFilter`: landmarks that are not points yet."""

    @property
    def counts(self) -> dict[int, int]:
        """Number of members of each provisional landmark, in the order of first bearings."""
        ...

    @property
    def log(self) -> RayRecorder | None:
        """Log of the rays; None without rays."""
        ...

    def observe(self, step: int, ids: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Process the bearings (m, 1), with covariances (m, 1, 1), of provisional and new landmarks `ids` (m,).

        Returns:
            The id in the `LandmarkMap` of each landmark that became a point.
        """
        ...

    def members(self) -> Members:
        """Return possible positions of the landmarks; a landmark without position has no row."""
        ...

    def member_ids(self) -> dict[int, Int]:
        """Return the ids in the `LandmarkMap` of members that can be associated with bearings, by landmark."""
        ...

    def forget(self, step: int, landmark: int) -> None:
        """Remove a provisional landmark from the state."""
        ...
