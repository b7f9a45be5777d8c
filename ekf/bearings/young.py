"""What the initialisations of bearing-only landmarks have in common: landmarks that are young, no points yet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.estimate import RayLog

POINT = -1  # number of a landmark that has no members


class Members(NamedTuple):
    """Where landmarks may be: a row for every member of every one."""

    landmark: Int  # (k,) id
    number: Int  # (k,) along the ray, from 0; POINT for a landmark that is a point
    weight: Float  # (k,) probability
    position: Float  # (k, 2) [m]
    cov: Float  # (k, 2, 2) [m^2]


def joined(parts: Sequence[Members]) -> Members:
    """The rows of all parts."""
    return Members(
        landmark=np.concatenate([part.landmark for part in parts]),
        number=np.concatenate([part.number for part in parts]),
        weight=np.concatenate([part.weight for part in parts]),
        position=np.concatenate([part.position for part in parts]),
        cov=np.concatenate([part.cov for part in parts]),
    )


NO_MEMBERS = Members(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2)))


class Young(Protocol):
    """Landmarks of a `BearingFilter` from their first bearing until they are points."""

    @property
    def counts(self) -> dict[int, int]:
        """The landmarks that are young, in the order of their first bearings, and how many members each has."""
        ...

    @property
    def log(self) -> RayRecorder | None:
        """What has become of the rays; None without rays."""
        ...

    def observe(self, step: int, names: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Take in the bearings (m, 1), with covariances (m, 1, 1), of young and new landmarks `names` (m,).

        Returns:
            The landmarks that became points, and the id of each in the `SlamFilter`.
        """
        ...

    def members(self) -> Members:
        """Where the landmarks may be; those of which nothing can be said have no row."""
        ...

    def member_ids(self) -> dict[int, Int]:
        """Ids in the `SlamFilter` of every young landmark's members that a bearing can be compared with."""
        ...

    def forget(self, step: int, name: int) -> None:
        """Take a young landmark out of the state."""
        ...


class RayRecorder:
    """Notes what becomes of rays."""

    def __init__(self) -> None:
        self._landmark: list[int] = []
        self._birth: list[int] = []
        self._distances: list[Float] = []
        self._end: list[int] = []
        self._survivor: list[int] = []
        self._open: dict[int, int] = {}  # landmark: row of its present ray

    def begin(self, step: int, name: int, distances: Float) -> None:
        """A ray begins with members at these distances [m]."""
        self._open[name] = len(self._landmark)
        self._landmark.append(name)
        self._birth.append(step)
        self._distances.append(distances)
        self._end.append(-1)
        self._survivor.append(-1)

    def end(self, step: int, name: int, survivor: int = -1) -> None:
        """Its ray became a point, the member `survivor`, or was lost (-1)."""
        row = self._open.pop(name)
        self._end[row], self._survivor[row] = step, survivor

    def log(self, members: Int) -> RayLog:
        """The rays so far, with the number of members (N+1,) after each step."""
        distances = np.full((len(self._landmark), max(map(len, self._distances), default=0)), np.nan)
        for row, given in enumerate(self._distances):
            distances[row, : len(given)] = given
        columns = (self._landmark, self._birth, self._end, self._survivor)
        landmark, birth, end, survivor = (np.array(column, dtype=np.int64) for column in columns)
        return RayLog(landmark, birth, end, survivor, distances, members)
