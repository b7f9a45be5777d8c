"""The schema of scenario files: every section, its keys and their units."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.derived import Number, Whole, rule_of, section_of
from slamgauge.ekf.settings.association import Association as FilterAssociation
from slamgauge.ekf.settings.association import MapManagement, Method
from slamgauge.ekf.settings.initialisation import Delayed as DelayedSettings
from slamgauge.ekf.settings.initialisation import Initialisation, Rays
from slamgauge.ekf.settings.initialisation import InverseDepth as InverseDepthSettings
from slamgauge.ekf.settings.rules import fitted
from slamgauge.errors import UserError

NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]

_MAX_STEPS = 1_000_000  # a misplaced decimal point shall not fill the memory
_SIGMAS = {
    "range-bearing": ("sigma_range", "sigma_bearing_deg"),
    "bearing": ("sigma_bearing_deg",),
    "position": ("sigma_position",),
}


class Section(BaseModel):
    """A table of the file: immutable, no keys but its own, finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Prior(Section):
    """The start pose: `mean` (x [m], y [m], heading [rad]) and independent `variances` [m^2, m^2, rad^2]."""

    mean: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    variances: tuple[NonNegative, NonNegative, NonNegative] = (0.01, 0.01, 0.0001)


class Segment(Section):
    """A stretch driven at constant `speed` [m/s] and `yaw_rate` [rad/s] for `duration` [s]."""

    speed: Number
    yaw_rate: Number
    duration: Positive


class Trajectory(Section):
    """The commanded path: segments driven one after the other, in time steps of `step` [s].

    A file may give speed, yaw_rate and duration in place of a single segment.
    """

    step: Positive
    segments: tuple[Segment, ...]

    @model_validator(mode="before")
    @classmethod
    def _single_segment(cls, table: object) -> object:
        if not isinstance(table, dict) or "segments" in table:
            return table
        segment = {key: value for key, value in table.items() if key in Segment.model_fields}
        rest = {key: value for key, value in table.items() if key not in Segment.model_fields}
        return {**rest, "segments": [segment]} if segment else rest

    @model_validator(mode="after")
    def _of_sane_length(self) -> Trajectory:
        if not self.segments:
            raise PydanticCustomError("too_short", "has no segment; add one")
        steps = sum(segment.duration for segment in self.segments) / self.step
        if steps > _MAX_STEPS:
            text = "duration / step comes to more than {most} steps; raise step or shorten duration"
            raise PydanticCustomError("too_long", text, {"most": _MAX_STEPS})
        return self

    @property
    def steps(self) -> tuple[int, ...]:
        """Number of steps of each segment: its duration to the nearest step, at least one."""
        return tuple(max(1, round(segment.duration / self.step)) for segment in self.segments)


class Motion(Section):
    """Odometry noise: standard deviations `sigma_speed` [m/s] and `sigma_yaw_rate_deg` [deg/s] of each step."""

    sigma_speed: NonNegative
    sigma_yaw_rate_deg: NonNegative


class Sensor(Section):
    """What is seen, all round, from `min_range` to `max_range` [m], its noise, and the `first_step` with a scan.

    `range-bearing` needs `sigma_range` [m] and `sigma_bearing_deg` [deg], `bearing` the latter alone; `position`
    (the landmark in the body frame) needs `sigma_position` [m] of each axis.
    """

    kind: Literal["range-bearing", "bearing", "position"]
    max_range: Positive
    min_range: NonNegative = 0.0
    first_step: Annotated[int, Field(ge=0, strict=True)] = 0
    sigma_range: Positive | None = Field(default=None, validate_default=True)
    sigma_bearing_deg: Positive | None = Field(default=None, validate_default=True)
    sigma_position: Positive | None = Field(default=None, validate_default=True)

    @field_validator("min_range")
    @classmethod
    def _below_max_range(cls, value: float, info: ValidationInfo) -> float:
        if value > info.data.get("max_range", np.inf):
            raise PydanticCustomError("order", "must not exceed max_range; nothing would be seen")
        return value

    @field_validator(*(key for keys in _SIGMAS.values() for key in keys))
    @classmethod
    def _fits_kind(cls, value: float | None, info: ValidationInfo) -> float | None:
        kind = info.data.get("kind")
        needed = info.field_name in _SIGMAS.get(kind or "", ())
        if kind and needed and value is None:
            raise PydanticCustomError("missing", "missing; a {kind} sensor needs it", {"kind": kind})
        if kind and not needed and value is not None:
            text = "a {kind} sensor has none; remove it or change kind"
            raise PydanticCustomError("foreign", text, {"kind": kind})
        return value

    @property
    def sigmas(self) -> Float:
        """Standard deviations (d,) of an observation: [m, rad], [rad] for `bearing`, [m, m] for `position`."""
        if self.kind == "position":
            return np.array([self.sigma_position, self.sigma_position], dtype=np.float64)
        if self.kind == "bearing":
            return np.deg2rad(np.array([self.sigma_bearing_deg], dtype=np.float64))
        return np.array([self.sigma_range, self.sigma_bearing_deg], dtype=np.float64) * [1.0, np.pi / 180.0]


class Assumed(Section):
    """What estimators believe: the simulated noise covariances times `scale`, and times a factor of each one's own."""

    scale: Positive = 1.0
    motion_scale: Positive = 1.0
    sensor_scale: Positive = 1.0


class Association(Section):
    """How filters find the landmark of an observation; `known` gives them the ids.

    `gate` is the largest squared Mahalanobis distance. `map_management` (probation, deletion and merging of
    landmarks, see `ekf.maps.tracks`) is off for `nearest-neighbour`, the practical's bare rule, and on for
    `jcbb`, unless it is said otherwise. The rest is that of `ekf.settings.association.Association`.
    """

    method: Literal["known", Method] = "known"
    gate: Annotated[Number, rule_of(FilterAssociation, "gate")] = FilterAssociation.gate
    map_management: Annotated[bool, Field(strict=True)] | None = None
    node_limit: Annotated[Whole, rule_of(FilterAssociation, "node_limit")] = FilterAssociation.node_limit

    def settings(self) -> FilterAssociation | None:
        """What filters take; None leaves them theirs, as where they are given the ids."""
        if self.method == "known":
            return None
        managed = self.method == "jcbb" if self.map_management is None else self.map_management
        return FilterAssociation(self.method, self.gate, MapManagement() if managed else None, self.node_limit)


# how landmarks begin where there are bearings alone: the keys are the settings' own, defaults and rules included
Fis = section_of("Fis", Rays, Section)
InverseDepth = section_of("InverseDepth", InverseDepthSettings, Section)
Delayed = section_of("Delayed", DelayedSettings, Section)
INITIALISATIONS = {"fis": Rays, "inverse-depth": InverseDepthSettings, "delayed": DelayedSettings}


class Landmarks(Section):
    """The map: `positions` of the landmarks, (x, y) [m]."""

    positions: tuple[tuple[Number, Number], ...]


class Scenario(Section):
    """One simulated run, but for its seed.

    Attributes:
        name: The file's name without its ending.
        description: One line for people.
        start: Whether the true start pose is the prior's mean, or sampled from the prior.
    """

    name: str
    description: str
    start: Literal["mean", "sampled"] = "mean"
    prior: Prior = Prior()
    trajectory: Trajectory
    motion: Motion
    sensor: Sensor
    assumed: Assumed = Assumed()
    association: Association = Association()
    initialisation: Literal["fis", "inverse-depth", "delayed"] = "fis"
    fis: Fis = Fis()  # pyright: ignore[reportInvalidTypeForm]
    inverse_depth: InverseDepth = InverseDepth()  # pyright: ignore[reportInvalidTypeForm]
    delayed: Delayed = Delayed()  # pyright: ignore[reportInvalidTypeForm]
    landmarks: Landmarks

    @property
    def initialisation_settings(self) -> Initialisation | None:
        """How bearing-only landmarks begin, fitted to the sensor's range where nothing is said; None with ranges."""
        if self.sensor.kind != "bearing":
            return None
        section: Section = getattr(self, self.initialisation.replace("-", "_"))
        return fitted(INITIALISATIONS[self.initialisation], self.sensor.max_range, **section.model_dump())

    @model_validator(mode="after")
    def _rays_reach(self) -> Scenario:
        if self.sensor.kind != "bearing":
            return self
        try:
            rays = fitted(Rays, self.sensor.max_range, **self.fis.model_dump())
        except UserError as error:
            raise PydanticCustomError("rule", "fis.{mistake}", {"mistake": str(error)}) from None
        if rays.s_max < self.sensor.max_range:
            text = "fis.s_max = {s_max} m is shorter than sensor.max_range = {reach} m; farther landmarks would be lost"
            raise PydanticCustomError("short", text, {"s_max": rays.s_max, "reach": self.sensor.max_range})
        return self

    @model_validator(mode="after")
    def _can_associate(self) -> Scenario:
        if self.sensor.kind == "bearing" and self.association.method != "known" and self.initialisation != "fis":
            text = 'association.method = "{method}" needs rays; set initialisation = "fis", or the method "known"'
            raise PydanticCustomError("foreign", text, {"method": self.association.method})
        return self
