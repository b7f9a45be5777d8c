"""Sensor models in the body frame: what a landmark at `delta` looks like, and where a sight puts it.

`delta` is the landmark in the body frame, R(heading)' (l - p) [m]. An observation has two rows:
range [m] and bearing [rad], or the two coordinates of the landmark [m]. A bearing alone is the second row;
the first then is 0 and says nothing.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float
from slamgauge.jit import kernel

RANGE_BEARING = 0
POSITION = 1
BEARING = 2
SENSOR_CODES = {"range-bearing": RANGE_BEARING, "position": POSITION, "bearing": BEARING}

MIN_BEARING_DISTANCE = 0.01  # m; the bearing of anything closer carries no information


@kernel
def wrap(angle: float) -> float:
    """Angle in rad brought into (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    return math.pi if wrapped <= -math.pi or wrapped > math.pi else wrapped  # rounding at the seam


@kernel
def observe(sensor: int, dx: float, dy: float) -> tuple[float, float, float, float, float, float]:
    """Prediction (z0, z1) for a landmark at delta = (dx, dy), and A = dz/d(delta) row by row.

    A bearing from closer than MIN_BEARING_DISTANCE, and a range from exactly 0, get zero rows.
    """
    if sensor == POSITION:
        return dx, dy, 1.0, 0.0, 0.0, 1.0
    distance = math.hypot(dx, dy)
    bearing = math.atan2(dy, dx)
    if sensor == BEARING:
        if distance < MIN_BEARING_DISTANCE:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        squared = distance * distance
        return 0.0, bearing, 0.0, 0.0, -dy / squared, dx / squared
    if distance < MIN_BEARING_DISTANCE:
        if distance == 0.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        return distance, bearing, dx / distance, dy / distance, 0.0, 0.0
    squared = distance * distance
    return distance, bearing, dx / distance, dy / distance, -dy / squared, dx / squared


@kernel
def locate(sensor: int, z0: float, z1: float) -> tuple[float, float, float, float, float, float]:
    """Delta = (dx, dy) of a landmark seen at (z0, z1), and B = d(delta)/dz row by row; not for a bearing alone."""
    if sensor == POSITION:
        return z0, z1, 1.0, 0.0, 0.0, 1.0
    c, s = math.cos(z1), math.sin(z1)
    return z0 * c, z0 * s, c, -z0 * s, s, z0 * c


@kernel
def wrap_innovation(sensor: int, row: int, value: float) -> float:
    """A difference of two observations' row; a bearing's is wrapped."""
    if sensor != POSITION and row == 1:
        return wrap(value)
    return value


@kernel
def observe_all(sensor: int, deltas: Float) -> tuple[Float, Float]:
    """Predictions (m, 2) for landmarks at deltas (m, 2), and A (m, 2, 2) of each: `observe` of many."""
    values, jacobians = np.empty((len(deltas), 2)), np.empty((len(deltas), 2, 2))
    for i in range(len(deltas)):
        z0, z1, a00, a01, a10, a11 = observe(sensor, deltas[i, 0], deltas[i, 1])
        values[i, 0], values[i, 1] = z0, z1
        jacobians[i, 0, 0], jacobians[i, 0, 1] = a00, a01
        jacobians[i, 1, 0], jacobians[i, 1, 1] = a10, a11
    return values, jacobians


@kernel
def locate_all(sensor: int, values: Float) -> tuple[Float, Float]:
    """Deltas (m, 2) of landmarks seen at values (m, 2), and B (m, 2, 2) of each: `locate` of many."""
    deltas, jacobians = np.empty((len(values), 2)), np.empty((len(values), 2, 2))
    for i in range(len(values)):
        dx, dy, b00, b01, b10, b11 = locate(sensor, values[i, 0], values[i, 1])
        deltas[i, 0], deltas[i, 1] = dx, dy
        jacobians[i, 0, 0], jacobians[i, 0, 1] = b00, b01
        jacobians[i, 1, 0], jacobians[i, 1, 1] = b10, b11
    return deltas, jacobians
