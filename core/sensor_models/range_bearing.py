"""Range [m] and bearing [rad] of a landmark.

The functions take numbers (in kernels) or arrays of equal shape (in numpy). The landmark is at dx, dy [m] in the body
frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamgauge.arrays import select
from slamgauge.sensor_models.bearing import gradient


def observe(dx: Any, dy: Any, nearest: float) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return range and bearing, and their Jacobian by (dx, dy) row by row.

    The bearing's row is zero closer than `nearest` [m]: there the bearing carries no information. The range's row is
    zero at distance 0.
    """
    distance, bearing = np.hypot(dx, dy), np.arctan2(dy, dx)
    across_x, across_y = gradient(dx, dy, distance * distance)
    is_apart, is_far = distance > 0.0, distance >= nearest
    along_x, along_y = select(is_apart, dx / distance, 0.0), select(is_apart, dy / distance, 0.0)
    return distance, bearing, along_x, along_y, select(is_far, across_x, 0.0), select(is_far, across_y, 0.0)


def locate(distance: Any, bearing: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return the landmark's dx, dy, and their Jacobian by (range, bearing) row by row."""
    c, s = np.cos(bearing), np.sin(bearing)
    return distance * c, distance * s, c, -distance * s, s, distance * c
