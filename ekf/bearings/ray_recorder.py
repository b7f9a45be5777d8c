"""Log of the rays of a filter."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.estimate import RayLog


class LoggedRay(NamedTuple):
    """A ray that started; see `RayLog`."""

    landmark: int
    birth: int
    distances: Float
    end: int = NONE
    survivor: int = NONE


class RayRecorder:
    """Logs start and end of rays.

    Attributes:
        step: present step of the filter.
    """

    def __init__(self) -> None:
        self.step = 0
        self._rays: list[LoggedRay] = []
        self._open: dict[int, int] = {}  # landmark to row of its present ray

    def copy(self) -> RayRecorder:
        """Return a copy that later rays do not change."""
        twin = copy(self)
        vars(twin).update(_rays=[*self._rays], _open={**self._open})
        return twin

    def begin(self, landmark: int, distances: Float) -> None:
        """Log a new ray with members at these distances [m]."""
        self._open[landmark] = len(self._rays)
        self._rays.append(LoggedRay(landmark, self.step, distances))

    def end(self, landmark: int, survivor: int = NONE) -> None:
        """Log that a ray became a point, the member `survivor`, or was deleted (-1)."""
        row = self._open.pop(landmark)
        self._rays[row] = self._rays[row]._replace(end=self.step, survivor=survivor)

    def log(self, members: Int) -> RayLog:
        """Return the rays so far, with the number of members (N+1,) after each step."""
        distances = np.full((len(self._rays), max((len(each.distances) for each in self._rays), default=0)), np.nan)
        for row, each in enumerate(self._rays):
            distances[row, : len(each.distances)] = each.distances
        columns = ([getattr(each, name) for each in self._rays] for name in ("landmark", "birth", "end", "survivor"))
        landmark, birth, end, survivor = (np.array(column, dtype=np.int64) for column in columns)
        return RayLog(landmark, birth, end, survivor, distances, members)
