"""What the poses of a window have seen, and where their bearings place a landmark."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.window.kernels import Observed, ObservedByPose
from slamgauge.sensor_kernels import DIM
from slamgauge.triangulation import triangulate

SURE = 0.3  # largest standard deviation over distance of a landmark that bearings place: what the optimum asks for, too
FEWEST = 3  # bearings that place a landmark


class Scan(NamedTuple):
    """Observations of one pose, or of several; landmarks by number, in the order of their first sight."""

    number: Int  # (m,)
    value: Float  # (m, 2)
    root: Float  # (m, 2, 2), see `advanced.window.kernels.Observed`

    def rows(self, which: Int) -> Scan:
        """Some of it."""
        return Scan(self.number[which], self.value[which], self.root[which])


NOTHING = Scan(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))


def scan_of(sensor: int, numbers: Int, values: Float, covs: Float) -> Scan:
    """Observations (m, 2) with covariances (m, 2, 2), as `in_two_rows` makes them."""
    roots = np.array(np.linalg.cholesky(np.linalg.inv(covs)).transpose(0, 2, 1), np.float64)
    roots[:, : 2 - DIM[sensor]] = 0.0
    return Scan(numbers, values, roots)


def in_two_rows(given: NDArray[np.generic], given_covs: NDArray[np.generic]) -> tuple[Float, Float]:
    """Observations (m, d) and their covariances as (m, 2) and (m, 2, 2); a bearing alone is the second of the rows."""
    count, dim = given.shape
    values, covs = np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1))
    values[:, 2 - dim :], covs[:, 2 - dim :, 2 - dim :] = given, given_covs
    return values, covs


def joined(scans: list[Scan]) -> Scan:
    """The scans of several poses as one."""
    if not scans:
        return NOTHING
    numbers, values, roots = zip(*scans, strict=True)
    return Scan(np.concatenate(numbers), np.concatenate(values), np.concatenate(roots))


def observed_by_pose(sensor: int, scans: list[Scan], slot_of: Int) -> ObservedByPose:
    """Return the scans of several poses as kernels read them; `slot_of` (landmarks,) contains slots by number."""
    together = joined(scans)
    first = np.cumsum([0, *(len(each.number) for each in scans)])
    return ObservedByPose(first, Observed(sensor, slot_of[together.number], together.value, together.root))


class Bearings(NamedTuple):
    """Bearings, each with the pose that took it."""

    scan: Scan  # of m observations
    pose: Float  # (m, 3)

    @classmethod
    def of(cls, scans: list[Scan], poses: Float) -> Bearings:
        """Those of several poses (k, 3)."""
        return cls(joined(scans), np.repeat(poses, [len(each.number) for each in scans], axis=0))

    def of_landmark(self, number: int) -> Bearings:
        """Those of one landmark."""
        rows = np.flatnonzero(self.scan.number == number)
        return Bearings(self.scan.rows(rows), self.pose[rows])

    def with_those(self, others: Bearings) -> Bearings:
        """Both."""
        return Bearings(joined([self.scan, others.scan]), np.concatenate([self.pose, others.pose]))

    def place(self) -> Float | None:
        """The landmark (2,) that they place, if they do."""
        if len(self.pose) < FEWEST:
            return None
        found = triangulate(self.pose, self.scan.value[:, 1], 1.0 / self.scan.root[:, 1, 1] ** 2, SURE)
        return found.landmark if found.placed else None
