"""Sections [motion] and [sensor]: what odometry and sensor measure, and with which errors."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.section import (
    NonNegative,
    Number,
    Positive,
    Probability,
    Section,
    Table,
    TableText,
    covariances,
    invalid,
    within,
)
from slamgauge.compare.storage.csv_folder import OBSERVED, POSE_COV
from slamgauge.sensors import SENSORS
from slamgauge.sensors import Sensor as SensorKind

COV_HEADER = ("step", *POSE_COV)
# limits of standard deviations: no robot exceeds the largest, and squares of the smallest are not 0
SPEED, TURN = within(1e-12, 1e4, "m/s"), within(1e-12, 1e4, "deg/s")
LENGTH, ANGLE = within(1e-12, 1e6, "m"), within(1e-12, 1e4, "deg")


class Motion(Section):
    """Odometry noise, which estimators receive as covariance, and odometry errors, which they do not receive.

    Noise has the standard deviations `sigma_speed` [m/s], `sigma_yaw_rate_deg` [deg/s] and, if it is given,
    `sigma_lateral` [m/s] (sideways) at each step. Alternatively each step has its own covariance in the body frame
    [m, m, rad]: a row of the file `covariances`.

    `scale_error` is the relative error of distances (0.02: 2 % too long), `turn_bias_per_metre` [rad/m] a turn to the
    left per distance. At each step the wheels slip with probability `slip_rate`: the measured distance is then longer
    by a factor 1 + u, u uniform between 0 and 1.
    """

    covariances: Table | None = None
    sigma_speed: Annotated[NonNegative | None, SPEED] = None
    sigma_yaw_rate_deg: Annotated[NonNegative | None, TURN] = None
    sigma_lateral: Annotated[NonNegative | None, SPEED] = None
    slip_rate: Probability = 0.0
    scale_error: Number = 0.0
    turn_bias_per_metre: Number = 0.0

    @field_validator("covariances")
    @classmethod
    def _are_covariances(cls, table: TableText | None) -> TableText | None:
        if table is not None:
            steps = table.rows(COV_HEADER)[:, 0]
            covariances(table, COV_HEADER, 3)
            if not np.array_equal(steps, np.arange(1, len(steps) + 1)):
                raise invalid(f"{table.name}: steps must be 1, 2, 3 and so on; sort the rows")
        return table

    @model_validator(mode="after")
    def _has_noise(self) -> Motion:
        for key in ("sigma_speed", "sigma_yaw_rate_deg", "sigma_lateral"):
            remedy = "" if key == "sigma_lateral" else "add it"
            _require_one(key, getattr(self, key), "motion.covariances" if self.covariances else "", remedy)
        return self

    @property
    def covs(self) -> Float | None:
        """Covariances (N, 3, 3) [m, m, rad] of the file's steps 1..N; None without file."""
        return None if self.covariances is None else covariances(self.covariances, COV_HEADER, 3)

    def sigmas(self, duration: Float) -> Float:
        """Return standard deviations (3,) or (N, 3) [m, m, rad] of increments of this duration, () or (N, 1) [s]."""
        assert self.sigma_speed is not None and self.sigma_yaw_rate_deg is not None
        return duration * np.array([self.sigma_speed, self.sigma_lateral or 0.0, np.deg2rad(self.sigma_yaw_rate_deg)])

    def misread(self, command: Float, slips: Float, shares: Float) -> Float:
        """Return odometry (N, 3) with errors but without noise, for uniform draws (N,) of slips and their shares."""
        if not (self.slip_rate or self.scale_error or self.turn_bias_per_metre):
            return command
        distance = np.linalg.norm(command[:, :2], axis=1)
        factor = (1.0 + self.scale_error) * (1.0 + np.where(slips < self.slip_rate, shares, 0.0))
        turn = command[:, 2] + self.turn_bias_per_metre * distance
        return np.column_stack([command[:, :2] * factor[:, None], turn])


def _require_one(key: str, value: float | None, table: str, remedy: str) -> None:
    """Refuse a standard deviation beside the key of a `table`, and neither of them if there is a `remedy`."""
    if value is None and not table and remedy:
        raise invalid(f"missing; {remedy}", key)
    if value is not None and table:
        raise invalid(f"{table} has the noise already; remove one of them", key)


# keys of the standard deviations of the observed values, angles in degrees
_SIGMAS: dict[str, tuple[str, ...]] = {
    kind: tuple(f"sigma_{name}{'_deg' * is_angle}" for name, is_angle in zip(model.sigmas, model.is_angle, strict=True))
    for kind, model in SENSORS.items()
}


class Sensor(Section):
    """Sensor: field of view, noise, and errors that estimators do not receive.

    The sensor observes landmarks between `min_range` and `max_range` [m] within `field_of_view_deg` [deg] about the
    heading, from `first_step` on, each with the `detection_probability`. Alternatively the file `sightings` lists the
    observed landmark (numbered from 0) of each step, at any range and bearing.

    `range-bearing` needs `sigma_range` [m] and `sigma_bearing_deg` [deg], `bearing` only the latter; `position`
    (the landmark in the body frame) needs `sigma_position` [m] of each axis. `sightings` may have a covariance for each
    observation instead. Estimators receive this noise.

    An observation is an outlier with probability `outlier_rate`: `uniform` in range and bearing over the field of view,
    or `wide`, with ten times the noise; with ids it keeps the id of its landmark. `clutter_rate` is the mean number of
    observations of no landmark at each step (Poisson), uniform over the field of view; with ids each has a new id.
    """

    kind: SensorKind
    max_range: Positive
    min_range: NonNegative = 0.0
    first_step: Annotated[int, Field(ge=0, strict=True)] = 0
    sightings: Table | None = None
    sigma_range: Annotated[Positive | None, LENGTH] = None
    sigma_bearing_deg: Annotated[Positive | None, ANGLE] = None
    sigma_position: Annotated[Positive | None, LENGTH] = None
    field_of_view_deg: Annotated[Positive, Field(le=360)] = 360.0
    detection_probability: Probability = 1.0
    outlier_rate: Probability = 0.0
    outlier: Literal["uniform", "wide"] = "uniform"
    clutter_rate: Annotated[NonNegative, Field(le=1000)] = 0.0

    @field_validator("sightings")
    @classmethod
    def _are_sightings(cls, table: TableText | None, info: ValidationInfo) -> TableText | None:
        kind = info.data.get("kind")
        if table is None or kind is None:
            return table
        steps, landmarks = table.rows(*_headers(kind))[:, :2].T
        bad = (np.diff(steps, prepend=0) < 0) | (steps % 1 != 0) | (landmarks < 0) | (landmarks % 1 != 0)
        if bad.any():
            where = f"{table.name}, line {int(bad.argmax()) + 2}"
            raise invalid(f"{where}: steps and landmarks are whole numbers from 0, and steps do not decrease")
        _covs_of(table, kind)
        return table

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Sensor:
        if self.min_range > self.max_range:
            raise invalid("must not exceed max_range; the sensor would observe nothing", "min_range")
        for key in dict.fromkeys(key for keys in _SIGMAS.values() for key in keys):
            value = getattr(self, key)
            if key in _SIGMAS[self.kind]:
                table = "sensor.sightings" if self.covs is not None else ""
                _require_one(key, value, table, f"a {self.kind} sensor needs it")
            elif value is not None:
                raise invalid(f"a {self.kind} sensor has none; remove it or change kind", key)
        return self

    @property
    def sigmas(self) -> Float:
        """Standard deviations (d,) of an observation: [m, rad], [rad] for `bearing`, [m, m] for `position`."""
        stated = np.array([getattr(self, key) for key in _SIGMAS[self.kind]], dtype=np.float64)
        return np.where(SENSORS[self.kind].is_angle, np.deg2rad(stated), stated)

    @property
    def sights(self) -> tuple[Int, Int] | None:
        """Steps (M,) and landmarks (M,) of the file `sightings`; None without file."""
        if self.sightings is None:
            return None
        steps, landmarks = self.sightings.rows(*_headers(self.kind))[:, :2].T.astype(np.int64)
        return steps, landmarks

    @property
    def covs(self) -> Float | None:
        """Covariances (M, d, d) of the file `sightings`; None if the sigmas apply to all observations."""
        return _covs_of(self.sightings, self.kind)


def sightings_header(kind: SensorKind, *, has_covs: bool) -> tuple[str, ...]:
    """Return the columns of a file of sightings."""
    return ("step", "landmark", *(OBSERVED[kind][SENSORS[kind].dim :] if has_covs else ()))


def _headers(kind: SensorKind) -> list[tuple[str, ...]]:
    return [sightings_header(kind, has_covs=has_covs) for has_covs in (False, True)]


def _covs_of(table: TableText | None, kind: SensorKind) -> Float | None:
    """Return the covariances (M, d, d) of a file of sightings; None if it has none."""
    header = sightings_header(kind, has_covs=True)
    if table is None or table.rows(*_headers(kind)).shape[1] < len(header):
        return None
    return covariances(table, header, SENSORS[kind].dim, is_definite=True)
