"""What becomes of rays, noted step by step."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.estimate import RayLog


class RayRecorder:
    """Notes what becomes of rays."""

    def __init__(self) -> None:
        self._landmark: list[int] = []
        self._birth: list[int] = []
        self._distances: list[Float] = []
        self._end: list[int] = []
        self._survivor: list[int] = []
        self._open: dict[int, int] = {}  # landmark: row of its present ray

    def begin(self, step: int, landmark: int, distances: Float) -> None:
        """A ray begins with members at these distances [m]."""
        self._open[landmark] = len(self._landmark)
        self._landmark.append(landmark)
        self._birth.append(step)
        self._distances.append(distances)
        self._end.append(-1)
        self._survivor.append(-1)

    def end(self, step: int, landmark: int, survivor: int = -1) -> None:
        """Its ray became a point, the member `survivor`, or was lost (-1)."""
        row = self._open.pop(landmark)
        self._end[row], self._survivor[row] = step, survivor

    def log(self, members: Int) -> RayLog:
        """The rays so far, with the number of members (N+1,) after each step."""
        distances = np.full((len(self._landmark), max(map(len, self._distances), default=0)), np.nan)
        for row, given in enumerate(self._distances):
            distances[row, : len(given)] = given
        columns = (self._landmark, self._birth, self._end, self._survivor)
        landmark, birth, end, survivor = (np.array(column, dtype=np.int64) for column in columns)
        return RayLog(landmark, birth, end, survivor, distances, members)
