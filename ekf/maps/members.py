"""Where landmarks may be: points, and landmarks of which several members are possible."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int

POINT = -1  # number of a landmark that has no members


class Members(NamedTuple):
    """A row for every point, and for every member of a landmark that is not a point yet."""

    landmark: Int  # (k,) id
    number: Int  # (k,) along the ray, from 0; POINT for a landmark that is a point
    weight: Float  # (k,) probability
    position: Float  # (k, 2) [m]
    cov: Float  # (k, 2, 2) [m^2]


def points(landmark: Int, position: Float, cov: Float) -> Members:
    """Landmarks (k,) that are points at positions (k, 2) with covariances (k, 2, 2)."""
    return Members(landmark, np.full(len(landmark), POINT), np.ones(len(landmark)), position, cov)


def joined(parts: Sequence[Members]) -> Members:
    """The rows of all parts."""
    return Members(
        landmark=np.concatenate([part.landmark for part in parts]),
        number=np.concatenate([part.number for part in parts]),
        weight=np.concatenate([part.weight for part in parts]),
        position=np.concatenate([part.position for part in parts]),
        cov=np.concatenate([part.cov for part in parts]),
    )


NO_MEMBERS = points(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
