"""Interface of the initialisations of bearing-only landmarks, and the log of rays."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.online_filter import Members
from slamgauge.estimate import RayLog


class LoggedRay(NamedTuple):
    """A ray that started; see `RayLog`."""

    landmark: int
    birth: int
    distances: Float
    end: int = -1
    survivor: int = -1


class RayRecorder:
    """Logs start and end of rays."""

    def __init__(self) -> None:
        self._rays: list[LoggedRay] = []
        self._open: dict[int, int] = {}  # landmark to row of its present ray

    def begin(self, step: int, landmark: int, distances: Float) -> None:
        """Log a new ray with members at these distances [m]."""
        self._open[landmark] = len(self._rays)
        self._rays.append(LoggedRay(landmark, step, distances))

    def end(self, step: int, landmark: int, survivor: int = -1) -> None:
        """Log that a ray became a point, the member `survivor`, or was deleted (-1)."""
        row = self._open.pop(landmark)
        self._rays[row] = self._rays[row]._replace(end=step, survivor=survivor)

    def log(self, members: Int) -> RayLog:
        """Return the rays so far, with the number of members (N+1,) after each step."""
        distances = np.full((len(self._rays), max((len(each.distances) for each in self._rays), default=0)), np.nan)
        for row, each in enumerate(self._rays):
            distances[row, : len(each.distances)] = each.distances
        columns = ([getattr(each, name) for each in self._rays] for name in ("landmark", "birth", "end", "survivor"))
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
