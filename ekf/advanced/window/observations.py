"""Observations of the poses of a window, and triangulation of landmarks from their bearings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.window.cost import Observed, ObservedByPose
from slamgauge.sensor_kernels import DIM
from slamgauge.triangulation import triangulate

SURE = 0.3  # largest standard deviation over distance of a triangulated landmark, the same as in the optimum
FEWEST = 3  # smallest number of bearings for a triangulation


class Scan(NamedTuple):
    """Observations of one or several poses; landmarks are numbered by first observation."""

    number: Int  # (m,)
    value: Float  # (m, 2)
    root: Float  # (m, 2, 2), see `advanced.window.cost.Observed`

    def rows(self, which: Int) -> Scan:
        """Return the observations with the given indices."""
        return Scan(self.number[which], self.value[which], self.root[which])


NOTHING = Scan(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))


def scan_of(sensor: int, numbers: Int, values: Float, covs: Float) -> Scan:
    """Return a scan of observations (m, 2) with covariances (m, 2, 2) in the form of `in_two_rows`."""
    roots = np.array(np.linalg.cholesky(np.linalg.inv(covs)).transpose(0, 2, 1), np.float64)
    roots[:, : 2 - DIM[sensor]] = 0.0
    return Scan(numbers, values, roots)


def in_two_rows(given: NDArray[np.generic], given_covs: NDArray[np.generic]) -> tuple[Float, Float]:
    """Return observations (m, d) and their covariances as (m, 2) and (m, 2, 2); a bearing-only value is entry 1."""
    count, dim = given.shape
    values, covs = np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1))
    values[:, 2 - dim :], covs[:, 2 - dim :, 2 - dim :] = given, given_covs
    return values, covs


def joined(scans: list[Scan]) -> Scan:
    """Return the scans of several poses as one."""
    if not scans:
        return NOTHING
    numbers, values, roots = zip(*scans, strict=True)
    return Scan(np.concatenate(numbers), np.concatenate(values), np.concatenate(roots))


def observed_by_pose(sensor: int, scans: list[Scan], slot_of: Int) -> ObservedByPose:
    """Return the scans of several poses in the form of kernels; `slot_of` (landmarks,) contains slots by number."""
    together = joined(scans)
    first = np.cumsum([0, *(len(each.number) for each in scans)])
    return ObservedByPose(first, Observed(sensor, slot_of[together.number], together.value, together.root))


class Bearings(NamedTuple):
    """Bearings (m,), each with the pose that observed it."""

    scan: Scan
    pose: Float  # (m, 3)

    @classmethod
    def of(cls, scans: list[Scan], poses: Float) -> Bearings:
        """Return the bearings of several poses (k, 3)."""
        return cls(joined(scans), np.repeat(poses, [len(each.number) for each in scans], axis=0))

    def of_landmark(self, number: int) -> Bearings:
        """Return the bearings of one landmark."""
        rows = np.flatnonzero(self.scan.number == number)
        return Bearings(self.scan.rows(rows), self.pose[rows])

    def joined_with(self, others: Bearings) -> Bearings:
        """Return these bearings followed by others."""
        return Bearings(joined([self.scan, others.scan]), np.concatenate([self.pose, others.pose]))

    def place(self) -> Float | None:
        """Return the triangulated landmark (2,), or None if the bearings do not place it."""
        if len(self.pose) < FEWEST:
            return None
        found = triangulate(self.pose, self.scan.value[:, 1], 1.0 / self.scan.root[:, 1, 1] ** 2, SURE)
        return found.landmark if found.placed else None
