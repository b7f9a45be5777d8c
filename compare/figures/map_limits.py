"""Limits of maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamgauge.arrays import Float

MARGIN = 0.06  # relative to the extent of the map, on each side
ROOM = 0.15  # the same, for positions that may diverge


def map_limits(sure: Sequence[Float], others: Sequence[Float]) -> tuple[Float, Float]:
    """Return corners low and high (2,) [m] around all `sure` positions (n, 2), and the `others` up to a margin.

    Rows of NaN (gaps of a ground truth) are ignored.
    """
    low, high = _corners(sure)
    extent = (high - low).max() or 1.0  # a single position needs an extent too
    lowest, highest = _corners([*sure, *others])
    low = np.maximum(lowest, low - ROOM * extent) - MARGIN * extent
    high = np.minimum(highest, high + ROOM * extent) + MARGIN * extent
    return low, high


def _corners(places: Sequence[Float]) -> tuple[Float, Float]:
    """Return the smallest and the largest coordinates (2,) of positions (n, 2), without copying these."""
    low = np.min([np.fmin.reduce(each, axis=0, initial=np.inf) for each in places], axis=0)
    return low, np.max([np.fmax.reduce(each, axis=0, initial=-np.inf) for each in places], axis=0)
