"""Bearing [rad] of a landmark; one bearing does not place it.

The functions take numbers (in kernels) or arrays of equal shape (in numpy). The landmark is at dx, dy [m] in the body
frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamgauge.arrays import select


def observe(dx: Any, dy: Any, nearest: float) -> tuple[Any, Any, Any]:
    """Return the bearing and its Jacobian by (dx, dy), which is zero closer than `nearest` [m]."""
    distance = np.hypot(dx, dy)
    across_x, across_y = gradient(dx, dy, distance * distance)
    is_far = distance >= nearest
    return np.arctan2(dy, dx), select(is_far, across_x, 0.0), select(is_far, across_y, 0.0)


def locate(bearing: Any) -> tuple[Any, Any, Any, Any]:
    """Return dx, dy of the point at a distance of 1 m, and their derivatives by the bearing."""
    c, s = np.cos(bearing), np.sin(bearing)
    return c, s, -s, c


def gradient(dx: Any, dy: Any, squared: Any) -> tuple[Any, Any]:
    """Return the derivatives of a bearing by dx and dy; `squared` is dx^2 + dy^2."""
    return -dy / squared, dx / squared
