"""The formulas of `slamgauge.se2` and `slamgauge.sensors`, compiled for kernels: each takes and returns numbers.

The caller passes the code of a sensor. In kernels every observation has two rows. A bearing-only observation has its
bearing in the second row; the first row is 0 and carries no information.
"""

from __future__ import annotations

from slamgauge import se2, sensors
from slamgauge.jit import inner
from slamgauge.sensors import MIN_BEARING_DISTANCE, SENSORS

POSITION, BEARING = SENSORS["position"].code, SENSORS["bearing"].code
_BY_CODE = sorted(SENSORS.values(), key=lambda each: each.code)
IS_ANGLE = tuple((False, *each.is_angle)[-2:] for each in _BY_CODE)  # for both rows
DIM = tuple(each.dim for each in _BY_CODE)  # rows that carry information
HAS_RANGE = tuple(each.has_range for each in _BY_CODE)
PLACES_LANDMARKS = tuple(each.places_landmarks for each in _BY_CODE)

wrap = inner(se2.wrap_angle)  # (angle) -> angle
mean_rotation = inner(se2.mean_cos_sin)  # (turn) -> (cosine, sine) of V(turn)
exp = inner(se2.exp_xy)  # (x, y, turn) -> (x, y)
log = inner(se2.log_xy)  # (x, y, turn) -> (x, y)
right_jacobian = inner(se2.right_jacobian_entries)  # (x, y, turn) -> (j00, j01, j02, j12)
observe_bearing = inner(sensors.observe_bearing)  # (dx, dy, nearest) -> (bearing, its two derivatives)
observe_polar = inner(sensors.observe_polar)  # (dx, dy, nearest) -> as `observe`
observe_position = inner(sensors.observe_position)  # (dx, dy, nearest) -> as `observe`
locate_polar = inner(sensors.locate_polar)  # (z0, z1) -> as `locate`
locate_position = inner(sensors.locate_position)  # (z0, z1) -> as `locate`
inner(se2.half_cotangent)  # a part of the formulas above, as the next two
inner(se2.jacobian_coefficients)
inner(sensors.bearing_gradient)


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
