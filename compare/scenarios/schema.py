"""The schema of scenario files: every section, its keys and their units."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.landmarks import Landmarks
from slamgauge.compare.scenarios.odometry_errors import Motion, covs
from slamgauge.compare.scenarios.section import NonNegative, Positive, Section
from slamgauge.compare.scenarios.sensor_errors import Sensor
from slamgauge.compare.scenarios.settings_sections import Number, Whole, rule_of, section_of
from slamgauge.compare.scenarios.trajectory import Csv, Trajectory
from slamgauge.ekf.setting_rules import fitted
from slamgauge.ekf.settings import Association as FilterAssociation
from slamgauge.ekf.settings import Delayed as DelayedSettings
from slamgauge.ekf.settings import Initialisation, MapManagement, Method, Rays, Robustness
from slamgauge.ekf.settings import InverseDepth as InverseDepthSettings
from slamgauge.errors import UserError
from slamgauge.se2 import between
from slamgauge.sensors import SENSORS
from slamgauge.validation import as_covariances

Row = tuple[Number, Number, Number]

_SAME_POSE = 1e-6  # m, rad: of a path's first pose and the prior's mean


class Prior(Section):
    """The start pose: `mean` (x [m], y [m], heading [rad]) and independent `variances` [m^2, m^2, rad^2].

    A `covariance`, row by row, stands in the place of the variances where they are not independent.
    """

    mean: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    variances: tuple[NonNegative, NonNegative, NonNegative] = (0.01, 0.01, 0.0001)
    covariance: tuple[Row, Row, Row] | None = None

    @field_validator("covariance")
    @classmethod
    def _is_one(cls, value: tuple[Row, Row, Row] | None) -> tuple[Row, Row, Row] | None:
        if value is None:
            return value
        try:
            as_covariances("covariance", value, (3, 3))
        except UserError as error:
            raise PydanticCustomError("rule", "{mistake}", {"mistake": str(error)}) from None
        return value

    @property
    def cov(self) -> Float:
        """(3, 3) [m, m, rad]."""
        return np.diag(self.variances) if self.covariance is None else np.array(self.covariance)


class Assumed(Section):
    """What estimators believe: the simulated noise covariances times `scale`, and times a factor of each one's own."""

    scale: Positive = 1.0
    motion_scale: Positive = 1.0
    sensor_scale: Positive = 1.0


class Association(Section):
    """How filters find the landmark of an observation; `known` gives them the ids.

    `gate` is the largest squared Mahalanobis distance. `map_management` (probation, deletion and merging of
    landmarks, see `ekf.maps.tracks`) is off for `nearest-neighbour`, the practical's bare rule, and on for
    `jcbb`, unless it is said otherwise. The rest is that of `ekf.settings.Association`.
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


# how updates are guarded against outliers, and how landmarks begin where there are bearings alone: the keys are the
# settings' own, defaults and rules included
Update = section_of("Update", __name__, Robustness, Section)
Fis = section_of("Fis", __name__, Rays, Section)
InverseDepth = section_of("InverseDepth", __name__, InverseDepthSettings, Section)
Delayed = section_of("Delayed", __name__, DelayedSettings, Section)
INITIALISATIONS = {"fis": Rays, "inverse-depth": InverseDepthSettings, "delayed": DelayedSettings}


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
    update: Update = Update()  # pyright: ignore[reportInvalidTypeForm]
    initialisation: Literal["fis", "inverse-depth", "delayed"] = "fis"
    fis: Fis = Fis()  # pyright: ignore[reportInvalidTypeForm]
    inverse_depth: InverseDepth = InverseDepth()  # pyright: ignore[reportInvalidTypeForm]
    delayed: Delayed = Delayed()  # pyright: ignore[reportInvalidTypeForm]
    landmarks: Landmarks

    @property
    def robustness(self) -> Robustness:
        """How updates are guarded against outliers, as filters take it."""
        section: Section = self.update
        return Robustness(**section.model_dump())

    @property
    def initialisation_settings(self) -> Initialisation | None:
        """How bearing-only landmarks begin, fitted to the sensor's range where nothing is said; None with ranges."""
        if SENSORS[self.sensor.kind].places_landmarks:
            return None
        section: Section = getattr(self, self.initialisation.replace("-", "_"))
        return fitted(INITIALISATIONS[self.initialisation], self.sensor.max_range, **section.model_dump())

    @model_validator(mode="after")
    def _rays_reach(self) -> Scenario:
        if SENSORS[self.sensor.kind].places_landmarks:
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
        if (
            not SENSORS[self.sensor.kind].places_landmarks
            and self.association.method != "known"
            and self.initialisation != "fis"
        ):
            text = 'association.method = "{method}" needs rays; set initialisation = "fis", or the method "known"'
            raise PydanticCustomError("foreign", text, {"method": self.association.method})
        return self

    @model_validator(mode="after")
    def _starts_where_its_path_does(self) -> Scenario:
        if not isinstance(self.trajectory, Csv):
            return self
        first = self.trajectory.poses[0]
        if np.abs(between(self.prior.mean, first)).max() > _SAME_POSE:
            text = "prior.mean: {mean} is not where the path of {name} starts; set it to {first}"
            known = {"mean": [*self.prior.mean], "name": self.trajectory.file.name, "first": first.tolist()}
            raise PydanticCustomError("start", text, known)
        return self

    @model_validator(mode="after")
    def _tables_fit(self) -> Scenario:
        motion, sights = self.motion.covariances, self.sensor.sights
        if motion is None and sights is None:
            return self
        steps = len(self.trajectory.increments(self.prior.mean))
        if motion is not None and len(covs(motion)) != steps:
            text = "motion.covariances: {name} has {rows} rows for {steps} steps of the path; give one for each"
            known = {"name": motion.name, "rows": len(covs(motion)), "steps": steps}
            raise PydanticCustomError("rows", text, known)
        for what, column, most in (("step", 0, steps), ("landmark", 1, len(self.landmarks.all()) - 1)):
            if sights is not None and sights[column].max(initial=0) > most:
                text = "sensor.sightings: {what} {value} does not exist; the last one is {most}"
                known = {"what": what, "value": int(sights[column].max()), "most": most}
                raise PydanticCustomError("rows", text, known)
        return self
