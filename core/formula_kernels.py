"""The formulas of `slamgauge.se2` and `slamgauge.sensors`, compiled for kernels: each takes and returns numbers.

The caller passes the code of a sensor. In kernels every observation has two rows. A bearing-only observation has its
bearing in the second row; the first row is 0 and carries no information.
"""

from __future__ import annotations

from slamgauge.jit import inner
from slamgauge.se2 import (
    exp_xy,
    half_cotangent,
    jacobian_coefficients,
    log_xy,
    mean_cos_sin,
    right_jacobian_entries,
    wrap_angle,
)
from slamgauge.sensors import (
    MIN_BEARING_DISTANCE,
    SENSORS,
    bearing_gradient,
    locate_polar,
    locate_position,
    observe_bearing,
    observe_polar,
    observe_position,
)

POSITION, BEARING = SENSORS["position"].code, SENSORS["bearing"].code
_BY_CODE = sorted(SENSORS.values(), key=lambda each: each.code)
IS_ANGLE = tuple((False, *each.is_angle)[-2:] for each in _BY_CODE)  # for both rows
DIM = tuple(each.dim for each in _BY_CODE)  # rows that carry information
HAS_RANGE = tuple(each.has_range for each in _BY_CODE)
PLACES_LANDMARKS = tuple(each.places_landmarks for each in _BY_CODE)

inner(half_cotangent)
inner(jacobian_coefficients)
wrap = inner(wrap_angle)  # (angle) -> angle
mean_rotation = inner(mean_cos_sin)  # (turn) -> (cosine, sine) of V(turn)
exp = inner(exp_xy)  # (x, y, turn) -> (x, y)
log = inner(log_xy)  # (x, y, turn) -> (x, y)
right_jacobian = inner(right_jacobian_entries)  # (x, y, turn) -> (j00, j01, j02, j12)
inner(bearing_gradient)
inner(observe_bearing)
inner(observe_polar)
inner(observe_position)
inner(locate_polar)
inner(locate_position)


@inner
def observe(sensor: int, dx: float, dy: float) -> tuple[float, float, float, float, float, float]:
    """Return the prediction (z0, z1) for a landmark at delta = (dx, dy), and A = dz/d(delta) row by row.

    A bearing from closer than MIN_BEARING_DISTANCE, and a range from exactly 0, get zero rows.
    """
    if sensor == POSITION:
        return observe_position(dx, dy, MIN_BEARING_DISTANCE)
    if sensor == BEARING:
        z1, a10, a11 = observe_bearing(dx, dy, MIN_BEARING_DISTANCE)
        return 0.0, z1, 0.0, 0.0, a10, a11
    return observe_polar(dx, dy, MIN_BEARING_DISTANCE)


@inner
def locate(sensor: int, z0: float, z1: float) -> tuple[float, float, float, float, float, float]:
    """Return delta = (dx, dy) of a landmark observed as (z0, z1), and B = d(delta)/dz row by row.

    With a bearing, z0 is the range that the caller assumes.
    """
    if sensor == POSITION:
        return locate_position(z0, z1)
    return locate_polar(z0, z1)


@inner
def wrap_innovation(sensor: int, row: int, value: float) -> float:
    """Return the difference of two observations in a row, wrapped into (-pi, pi] if the row is an angle."""
    return wrap(value) if IS_ANGLE[sensor][row] else value
