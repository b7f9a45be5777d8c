"""Poses and covariances of a path, interpolated to other times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.se2 import wrap

SAME = 1e-6  # s: nearer stamps are the same; a float64 of today's time in seconds resolves 2e-7 s


class Neighbours(NamedTuple):
    """Stamps on both sides of each time (M,).

    Attributes:
        before: index of the last stamp that is not after the time.
        after: index of the next stamp.
        share: position of the time between both, 0 to 1.
        known: whether the time is at a stamp, or between two that are near enough.
    """

    before: Int
    after: Int
    share: Float
    known: Marks


def neighbours(stamps: Float, times: Float, max_gap: float) -> Neighbours:
    """Find the stamps (n,) on both sides of times (M,) [s].

    A time is not known if it is outside the stamps, or between two that are more than `max_gap` [s] apart.
    """
    before = np.clip(np.searchsorted(stamps, times + SAME, side="right") - 1, 0, len(stamps) - 1)
    after = np.minimum(before + 1, len(stamps) - 1)
    gap = stamps[after] - stamps[before]
    share = np.clip((times - stamps[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)
    met = np.abs(times - stamps[before]) <= SAME
    share[met] = 0.0
    return Neighbours(before, after, share, met | ((times > stamps[0]) & (times < stamps[-1]) & (gap <= max_gap)))


def interpolated(stamps: Float, poses: Float, times: Float, max_gap: float) -> Float:
    """Interpolate poses (n, 3) at stamps (n,) to times (M,) [s], headings along the shorter arc.

    Rows of times that are not known (see `neighbours`) are NaN.
    """
    before, after, share, known = neighbours(stamps, times, max_gap)
    found = poses[before] + share[:, None] * (poses[after] - poses[before])
    found[:, 2] = wrap(poses[before, 2] + share * wrap(poses[after, 2] - poses[before, 2]))
    found[~known] = np.nan
    return found


def interpolated_covs(stamps: Float, covs: Float, times: Float) -> Float:
    """Interpolate covariances (n, d, d) at stamps (n,) linearly to times (M,) [s]."""
    before, after, share, _ = neighbours(stamps, times, np.inf)
    return covs[before] + share[:, None, None] * (covs[after] - covs[before])
