"""What the sensor sees, and what is wrong with that."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.csv_tables import Table, TableText, covariances
from slamgauge.compare.scenarios.section import NonNegative, Positive, Probability, Section
from slamgauge.compare.storage.csv_folder import OBSERVED
from slamgauge.sensors import SENSORS, SensorModel
from slamgauge.sensors import Sensor as SensorKind


def _keys_of(model: SensorModel) -> tuple[str, ...]:
    """Return the key of each number's standard deviation, angles in degrees."""
    names = zip(model.sigmas, model.is_angle, strict=True)
    return tuple(f"sigma_{name}{'_deg' if is_angle else ''}" for name, is_angle in names)


_SIGMAS: dict[str, tuple[str, ...]] = {name: _keys_of(model) for name, model in SENSORS.items()}
SIGHT = ("step", "landmark")


class Sensor(Section):
    """What is seen, its noise, and what is wrong beside it.

    Seen is what lies from `min_range` to `max_range` [m] and in the `field_of_view_deg` [deg] about straight ahead,
    from the `first_step` on, each time with the `detection_probability`. Or the file `sightings` says which landmark
    (by its number, from 0) is seen at which step, whatever its distance and direction.

    `range-bearing` needs `sigma_range` [m] and `sigma_bearing_deg` [deg], `bearing` the latter alone; `position`
    (the landmark in the body frame) needs `sigma_position` [m] of each axis. `sightings` may have a covariance for each
    instead. Estimators are told of this noise, but not of what follows:

    An observation is an outlier with probability `outlier_rate`: `uniform` in range and direction over all that the
    sensor sees, or `wide`, with ten times the noise. With ids, it has that of its landmark still. `clutter_rate` is the
    mean number of observations of nothing in each step (Poisson), uniform likewise; with ids, each has one of its own.
    """

    kind: SensorKind
    max_range: Positive
    min_range: NonNegative = 0.0
    first_step: Annotated[int, Field(ge=0, strict=True)] = 0
    sightings: Table | None = None
    sigma_range: Positive | None = Field(default=None, validate_default=True)
    sigma_bearing_deg: Positive | None = Field(default=None, validate_default=True)
    sigma_position: Positive | None = Field(default=None, validate_default=True)
    field_of_view_deg: Annotated[Positive, Field(le=360)] = 360.0
    detection_probability: Probability = 1.0
    outlier_rate: Probability = 0.0
    outlier: Literal["uniform", "wide"] = "uniform"
    clutter_rate: Annotated[NonNegative, Field(le=1000)] = 0.0

    @field_validator("min_range")
    @classmethod
    def _below_max_range(cls, value: float, info: ValidationInfo) -> float:
        if value > info.data.get("max_range", np.inf):
            raise PydanticCustomError("order", "must not exceed max_range; nothing would be seen")
        return value

    @field_validator("sightings")
    @classmethod
    def _are_sightings(cls, table: TableText | None, info: ValidationInfo) -> TableText | None:
        kind = info.data.get("kind")
        if table is None or kind is None:
            return table
        steps, landmarks = table.rows(*_headers(kind))[:, :2].T
        bad = (np.diff(steps, prepend=0) < 0) | (steps % 1 != 0) | (landmarks < 0) | (landmarks % 1 != 0)
        if bad.any():
            text = "{name}, line {line}: steps and landmarks are whole numbers from 0, and steps do not decrease"
            raise PydanticCustomError("table", text, {"name": table.name, "line": int(bad.argmax()) + 2})
        _covs_of(table, kind)
        return table

    @field_validator(*dict.fromkeys(key for keys in _SIGMAS.values() for key in keys))
    @classmethod
    def _fits_kind(cls, value: float | None, info: ValidationInfo) -> float | None:
        kind = info.data.get("kind")
        needed = info.field_name in _SIGMAS.get(kind or "", ())
        if kind and not needed and value is not None:
            text = "a {kind} sensor has none; remove it or change kind"
            raise PydanticCustomError("foreign", text, {"kind": kind})
        if not kind or not needed or "sightings" not in info.data:
            return value
        has_covs = _covs_of(info.data["sightings"], kind) is not None
        if value is None and not has_covs:
            raise PydanticCustomError("missing", "missing; a {kind} sensor needs it", {"kind": kind})
        if value is not None and has_covs:
            raise PydanticCustomError("foreign", "sensor.sightings has the noise already; remove one of them")
        return value

    @property
    def sigmas(self) -> Float:
        """Standard deviations (d,) of an observation: [m, rad], [rad] for `bearing`, [m, m] for `position`."""
        stated = np.array([getattr(self, key) for key in _SIGMAS[self.kind]], dtype=np.float64)
        return np.where(SENSORS[self.kind].is_angle, np.deg2rad(stated), stated)

    @property
    def sights(self) -> tuple[Int, Int] | None:
        """Steps (M,) and landmarks (M,) of the file; None where range and direction decide."""
        if self.sightings is None:
            return None
        rows = self.sightings.rows(*_headers(self.kind))[:, :2].astype(np.int64)
        return rows[:, 0], rows[:, 1]

    @property
    def covs(self) -> Float | None:
        """Covariances (M, d, d) of the file's sightings; None where the sigmas are those of all."""
        return _covs_of(self.sightings, self.kind)


def sightings_header(kind: SensorKind, *, has_covs: bool) -> tuple[str, ...]:
    """The columns of a file of sightings."""
    return (*SIGHT, *OBSERVED[kind][SENSORS[kind].dim :]) if has_covs else SIGHT


def _headers(kind: SensorKind) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return sightings_header(kind, has_covs=False), sightings_header(kind, has_covs=True)


def _covs_of(table: TableText | None, kind: SensorKind) -> Float | None:
    """Covariances (M, d, d) of a file of sightings; None where it has none."""
    with_covs = _headers(kind)[1]
    if table is None or table.rows(*_headers(kind)).shape[1] < len(with_covs):
        return None
    return covariances(table, with_covs, SENSORS[kind].dim, is_definite=True)
