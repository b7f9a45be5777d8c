"""The formulas of each sensor, the table of sensors, and their models in numpy for a sensor by name.

`delta` (..., 2) [m] is the landmark in the body frame, R(heading)' (l - p). An observation z (..., d) has the d numbers
of its sensor. The formulas of the first part take numbers or arrays of equal shape; `slamgauge.formula_kernels`
compiles the same functions for kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, select
from slamgauge.se2 import wrap

Sensor = Literal["range-bearing", "bearing", "position"]
MIN_BEARING_DISTANCE = 0.01  # m; a bearing from closer carries no information

# --- formulas for numbers and arrays; the landmark is at dx, dy [m] in the body frame ---------------


def observe_polar(dx: Any, dy: Any, nearest: float) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return range [m] and bearing [rad], and their Jacobian by (dx, dy) row by row.

    The bearing's row is zero closer than `nearest` [m]: there the bearing carries no information. The range's row is
    zero at distance 0.
    """
    distance, bearing = np.hypot(dx, dy), np.arctan2(dy, dx)
    across_x, across_y = bearing_gradient(dx, dy, distance * distance)
    is_apart, is_far = distance > 0.0, distance >= nearest
    along_x, along_y = select(is_apart, dx / distance, 0.0), select(is_apart, dy / distance, 0.0)
    return distance, bearing, along_x, along_y, select(is_far, across_x, 0.0), select(is_far, across_y, 0.0)


def locate_polar(distance: Any, bearing: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return the landmark's dx, dy, and their Jacobian by (range, bearing) row by row."""
    c, s = np.cos(bearing), np.sin(bearing)
    return distance * c, distance * s, c, -distance * s, s, distance * c


def observe_bearing(dx: Any, dy: Any, nearest: float) -> tuple[Any, Any, Any]:
    """Return the bearing [rad] and its Jacobian by (dx, dy), which is zero closer than `nearest` [m]."""
    distance = np.hypot(dx, dy)
    across_x, across_y = bearing_gradient(dx, dy, distance * distance)
    is_far = distance >= nearest
    return np.arctan2(dy, dx), select(is_far, across_x, 0.0), select(is_far, across_y, 0.0)


def locate_bearing(bearing: Any) -> tuple[Any, Any, Any, Any]:
    """Return dx, dy of the point at a distance of 1 m, and their derivatives by the bearing."""
    c, s = np.cos(bearing), np.sin(bearing)
    return c, s, -s, c


def bearing_gradient(dx: Any, dy: Any, squared: Any) -> tuple[Any, Any]:
    """Return the derivatives of a bearing by dx and dy; `squared` is dx^2 + dy^2."""
    return -dy / squared, dx / squared


def observe_position(dx: Any, dy: Any, nearest: float) -> tuple[Any, Any, float, float, float, float]:  # noqa: ARG001
    """Return the position itself, and its Jacobian (the unit matrix) row by row; `nearest` is not needed."""
    return dx, dy, 1.0, 0.0, 0.0, 1.0


def locate_position(x: Any, y: Any) -> tuple[Any, Any, float, float, float, float]:
    """Return the landmark's dx, dy, and their Jacobian by (x, y) row by row."""
    return x, y, 1.0, 0.0, 0.0, 1.0


# --- the table ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SensorModel:
    """One sensor.

    Attributes:
        name: as in `Recording.sensor`.
        code: number of the sensor in kernels.
        columns: name of each number of an observation.
        units: their units; numbers in rad are angles.
        sigmas: names of their standard deviations; equal names share one.
        places_landmarks: whether one observation gives the landmark's position.
        observe: (dx, dy, nearest) to z and A = dz/d(delta), row by row.
        locate: z to delta and B = d(delta)/dz, row by row.
    """

    name: Sensor
    code: int
    columns: tuple[str, ...]
    units: tuple[str, ...]
    sigmas: tuple[str, ...]
    places_landmarks: bool
    observe: Callable[..., tuple[Any, ...]]
    locate: Callable[..., tuple[Any, ...]]

    @property
    def dim(self) -> int:
        """Number d of columns of an observation."""
        return len(self.columns)

    @property
    def is_angle(self) -> tuple[bool, ...]:
        """Which numbers of an observation are angles."""
        return tuple(unit == "rad" for unit in self.units)

    @property
    def has_range(self) -> bool:
        """Whether the first number of an observation is a range, which cannot be negative."""
        return self.columns[0] == "range"

    @property
    def has_bearing(self) -> bool:
        """Whether the last number of an observation is a bearing."""
        return self.columns[-1] == "bearing"


_ENTRIES = (
    SensorModel(
        name="range-bearing",
        code=0,
        columns=("range", "bearing"),
        units=("m", "rad"),
        sigmas=("range", "bearing"),
        places_landmarks=True,
        observe=observe_polar,
        locate=locate_polar,
    ),
    SensorModel(
        name="bearing",
        code=2,
        columns=("bearing",),
        units=("rad",),
        sigmas=("bearing",),
        places_landmarks=False,
        observe=observe_bearing,
        locate=locate_bearing,
    ),
    SensorModel(
        name="position",
        code=1,
        columns=("x", "y"),
        units=("m", "m"),
        sigmas=("position", "position"),
        places_landmarks=True,
        observe=observe_position,
        locate=locate_position,
    ),
)
SENSORS: dict[str, SensorModel] = {each.name: each for each in _ENTRIES}
OBSERVATION_DIM = {name: each.dim for name, each in SENSORS.items()}
PLACING = tuple(name for name, each in SENSORS.items() if each.places_landmarks)

# --- models in numpy --------------------------------------------------------------------------------


def predict(sensor: str, delta: ArrayLike) -> Float:
    """Return the observation z (..., d) of a landmark at delta (..., 2)."""
    return _observed(sensor, delta, 0.0)[0]


def jacobian(sensor: str, delta: ArrayLike, nearest: float = MIN_BEARING_DISTANCE) -> Float:
    """Return A = dz/d(delta) (..., d, 2) for a landmark at delta (..., 2).

    The row of a bearing is zero closer than `nearest` [m]: there a bearing carries no information.
    """
    return _observed(sensor, delta, nearest)[1]


def inverse(sensor: str, z: ArrayLike) -> Float:
    """Return delta (..., 2) of a landmark that is observed as z (..., d); a bearing puts it at a distance of 1 m."""
    return _located(sensor, z)[0]


def inverse_jacobian(sensor: str, z: ArrayLike) -> Float:
    """Return B = d(delta)/dz (..., 2, d) of `inverse`."""
    return _located(sensor, z)[1]


def innovation(sensor: str, z: ArrayLike, predicted: ArrayLike) -> Float:
    """Return z - predicted (..., d), bearings wrapped into (-pi, pi]."""
    difference = np.asarray(z, dtype=np.float64) - np.asarray(predicted, dtype=np.float64)
    for row, is_angle in enumerate(SENSORS[sensor].is_angle):
        if is_angle:
            difference[..., row] = wrap(difference[..., row])
    return difference


@np.errstate(divide="ignore", invalid="ignore")  # at distance 0
def _observed(sensor: str, delta: ArrayLike, nearest: float) -> tuple[Float, Float]:
    """Return predictions (..., d) and Jacobians (..., d, 2)."""
    model, delta = SENSORS[sensor], np.asarray(delta, dtype=np.float64)
    return _split(model.observe(delta[..., 0], delta[..., 1], nearest), model.dim, 2)


def _located(sensor: str, z: ArrayLike) -> tuple[Float, Float]:
    """Return landmarks (..., 2) in the body frame and their Jacobians (..., 2, d)."""
    model, z = SENSORS[sensor], np.asarray(z, dtype=np.float64)
    return _split(model.locate(*np.moveaxis(z, -1, 0)), 2, model.dim)


def _split(parts: tuple[Any, ...], rows: int, columns: int) -> tuple[Float, Float]:
    """Return values (..., rows) and Jacobians (..., rows, columns) from the results of a model."""
    whole = np.stack(np.broadcast_arrays(*parts), axis=-1)
    return whole[..., :rows], whole[..., rows:].reshape(*whole.shape[:-1], rows, columns)
