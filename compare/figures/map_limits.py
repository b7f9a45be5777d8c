"""The part of the plane that a picture shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamgauge.arrays import Float

MARGIN = 0.06  # of the map's extent, on each side
ROOM = 0.15  # of the map's extent, on each side, for what may go astray


def map_limits(sure: Sequence[Float], astray: Sequence[Float]) -> tuple[Float, Float]:
    """Corners low and high (2,) [m] that hold all `sure` positions (n, 2), and the others as far as there is room.

    Rows of NaN, gaps of a ground truth, count for nothing.
    """
    low, high = _corners(sure)
    extent = (high - low).max() or 1.0  # a single place needs a size too
    lowest, highest = _corners([*sure, *astray])
    low = np.maximum(lowest, low - ROOM * extent) - MARGIN * extent
    high = np.minimum(highest, high + ROOM * extent) + MARGIN * extent
    return low, high


def _corners(places: Sequence[Float]) -> tuple[Float, Float]:
    """The smallest and the largest coordinates (2,) of places (n, 2), without a copy of them."""
    low = np.min([np.fmin.reduce(each, axis=0, initial=np.inf) for each in places], axis=0)
    return low, np.max([np.fmax.reduce(each, axis=0, initial=-np.inf) for each in places], axis=0)
