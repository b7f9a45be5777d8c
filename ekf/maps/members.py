"""Tables of points and members of rays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int

POINT = -1  # number of a landmark without members


class Members(NamedTuple):
    """A row for every point, and for every member of a ray."""

    landmark: Int  # (k,) id
    number: Int  # (k,) along the ray, from 0; POINT for a point
    weight: Float  # (k,) probability
    position: Float  # (k, 2) [m]
    cov: Float  # (k, 2, 2) [m^2]


def points(landmark: Int, position: Float, cov: Float) -> Members:
    """Return rows for points (k,) at positions (k, 2) with covariances (k, 2, 2)."""
    return Members(landmark, np.full(len(landmark), POINT), np.ones(len(landmark)), position, cov)


def joined(parts: Sequence[Members]) -> Members:
    """Return the rows of all parts."""
    return Members(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


NO_MEMBERS = points(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
