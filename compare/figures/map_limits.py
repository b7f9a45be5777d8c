"""The part of the plane that a picture shows."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float

MARGIN = 0.06  # of the map's extent, on each side
ROOM = 0.15  # of the map's extent, on each side, for what may go astray


def map_limits(sure: Float, astray: Float) -> tuple[Float, Float]:
    """Corners low and high (2,) [m] that hold the `sure` positions (n, 2), and the others as far as there is room.

    Rows of NaN, gaps of a ground truth, count for nothing.
    """
    low, high = np.nanmin(sure, axis=0), np.nanmax(sure, axis=0)
    extent = (high - low).max() or 1.0  # a single place needs a size too
    everything = np.concatenate([sure, astray])
    low = np.maximum(np.nanmin(everything, axis=0), low - ROOM * extent) - MARGIN * extent
    high = np.minimum(np.nanmax(everything, axis=0), high + ROOM * extent) + MARGIN * extent
    return low, high
