"""The models of `slamgauge.sensor_models`, compiled; the caller passes the code of a sensor.

In kernels every observation has two rows. A bearing-only observation has its bearing in the second row; the first row
is 0 and carries no information.
"""

from __future__ import annotations

from slamgauge.jit import inner
from slamgauge.se2_kernels import wrap
from slamgauge.sensor_models import bearing, position, range_bearing
from slamgauge.sensors import MIN_BEARING_DISTANCE, SENSORS

RANGE_BEARING, POSITION, BEARING = (SENSORS[name].code for name in ("range-bearing", "position", "bearing"))
_BY_CODE = sorted(SENSORS.values(), key=lambda each: each.code)
IS_ANGLE = tuple((False, *each.is_angle)[-2:] for each in _BY_CODE)  # for both rows
DIM = tuple(each.dim for each in _BY_CODE)  # rows that carry information
HAS_RANGE = tuple(each.has_range for each in _BY_CODE)
HAS_BEARING = tuple(each.has_bearing for each in _BY_CODE)
PLACES_LANDMARKS = tuple(each.places_landmarks for each in _BY_CODE)

inner(bearing.gradient)
_observe_polar, _locate_polar = inner(range_bearing.observe), inner(range_bearing.locate)
_observe_position, _locate_position = inner(position.observe), inner(position.locate)
_observe_bearing = inner(bearing.observe)


@inner
def observe(sensor: int, dx: float, dy: float) -> tuple[float, float, float, float, float, float]:
    """Return the prediction (z0, z1) for a landmark at delta = (dx, dy), and A = dz/d(delta) row by row.

    A bearing from closer than MIN_BEARING_DISTANCE, and a range from exactly 0, get zero rows.
    """
    if sensor == POSITION:
        return _observe_position(dx, dy, MIN_BEARING_DISTANCE)
    if sensor == BEARING:
        z1, a10, a11 = _observe_bearing(dx, dy, MIN_BEARING_DISTANCE)
        return 0.0, z1, 0.0, 0.0, a10, a11
    return _observe_polar(dx, dy, MIN_BEARING_DISTANCE)


@inner
def locate(sensor: int, z0: float, z1: float) -> tuple[float, float, float, float, float, float]:
    """Return delta = (dx, dy) of a landmark observed as (z0, z1), and B = d(delta)/dz row by row.

    With a bearing, z0 is the range that the caller assumes.
    """
    if sensor == POSITION:
        return _locate_position(z0, z1)
    return _locate_polar(z0, z1)


@inner
def wrap_innovation(sensor: int, row: int, value: float) -> float:
    """Return the difference of two observations in a row, wrapped into (-pi, pi] if the row is an angle."""
    return wrap(value) if IS_ANGLE[sensor][row] else value
