"""The schema of scenario files: every section, its keys and their units."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.landmarks import Landmarks
from slamgauge.compare.scenarios.measurement_errors import Motion, Sensor, covs
from slamgauge.compare.scenarios.section import (
    NonNegative,
    Number,
    Positive,
    Section,
    Whole,
    invalid,
    rule_of,
    section_of,
    within,
)
from slamgauge.compare.scenarios.trajectory import Csv, Trajectory
from slamgauge.ekf.setting_rules import fitted
from slamgauge.ekf.settings import Association as FilterAssociation
from slamgauge.ekf.settings import Delayed as DelayedSettings
from slamgauge.ekf.settings import Initialisation, MapManagement, Method, Rays, Robustness
from slamgauge.errors import UserError
from slamgauge.se2 import between
from slamgauge.sensors import SENSORS
from slamgauge.validation import as_covariances

Row = tuple[Number, Number, Number]
Place = Annotated[Number, within(0.0, 1e9, "m")]  # farther away, errors of centimetres are rounded

_SAME_POSE = 1e-6  # m, rad: largest difference between a path's first pose and the prior's mean


class Prior(Section):
    """The start pose: `mean` (x [m], y [m], heading [rad]) and independent `variances` [m^2, m^2, rad^2].

    A `covariance`, row by row, replaces the variances if they are not independent.
    """

    mean: tuple[Place, Place, Number] = (0.0, 0.0, 0.0)
    variances: tuple[NonNegative, NonNegative, NonNegative] = (0.01, 0.01, 0.0001)
    covariance: tuple[Row, Row, Row] | None = None

    @field_validator("covariance")
    @classmethod
    def _is_covariance(cls, value: tuple[Row, Row, Row] | None) -> tuple[Row, Row, Row] | None:
        if value is None:
            return value
        try:
            as_covariances("covariance", value, (3, 3))
        except UserError as error:
            raise invalid(str(error)) from None
        return value

    @property
    def cov(self) -> Float:
        """Covariance (3, 3) [m, m, rad]."""
        return np.diag(self.variances) if self.covariance is None else np.array(self.covariance)


class Assumed(Section):
    """Noise that estimators assume: the simulated covariances times `scale`, and times a factor for each kind."""

    scale: Positive = 1.0
    motion_scale: Positive = 1.0
    sensor_scale: Positive = 1.0


class Association(Section):
    """Data association of the filters; with `known` they receive the ids.

    `gate` is the largest squared Mahalanobis distance. `map_management` (probation, deletion and merging of
    landmarks, see `ekf.maps.tracks`) is by default off for `nearest-neighbour`, the exercise's rule, and on for
    `jcbb`. `ekf.settings.Association` describes the rest.
    """

    method: Literal["known", Method] = "known"
    gate: Annotated[Number, rule_of(FilterAssociation, "gate")] = FilterAssociation.gate
    map_management: Annotated[bool, Field(strict=True)] | None = None
    node_limit: Annotated[Whole, rule_of(FilterAssociation, "node_limit")] = FilterAssociation.node_limit

    def settings(self) -> FilterAssociation | None:
        """Return the settings of the filters; None (the filters' own) with known association."""
        if self.method == "known":
            return None
        managed = self.method == "jcbb" if self.map_management is None else self.map_management
        return FilterAssociation(self.method, self.gate, MapManagement() if managed else None, self.node_limit)


# keys, defaults and rules are those of the filters' settings
Update = section_of("Update", __name__, Robustness)
Fis = section_of("Fis", __name__, Rays)
Delayed = section_of("Delayed", __name__, DelayedSettings)
INITIALISATIONS = {"fis": Rays, "delayed": DelayedSettings}


class Scenario(Section):
    """A simulated run without its seed.

    Attributes:
        name: the file's name without its ending.
        description: one line for users.
        start: true start pose: sampled from the prior, or the prior's mean.
    """

    name: str
    description: str
    start: Literal["mean", "sampled"] = "sampled"
    prior: Prior = Prior()
    trajectory: Trajectory
    motion: Motion
    sensor: Sensor
    assumed: Assumed = Assumed()
    association: Association = Association()
    update: Update = Update()
    initialisation: Literal["fis", "delayed"] = "fis"
    fis: Fis = Fis()
    delayed: Delayed = Delayed()
    landmarks: Landmarks

    @property
    def robustness(self) -> Robustness:
        """How updates reject or weight outliers, as filters receive it."""
        section: Section = self.update
        return Robustness(**section.model_dump())

    @property
    def is_bearing_only(self) -> bool:
        """Whether one observation does not give the position of a landmark."""
        return not SENSORS[self.sensor.kind].places_landmarks

    @property
    def initialisation_settings(self) -> Initialisation | None:
        """Initialisation of bearing-only landmarks; unset keys depend on the sensor's range. None for other sensors."""
        if not self.is_bearing_only:
            return None
        section: Section = getattr(self, self.initialisation.replace("-", "_"))
        return fitted(INITIALISATIONS[self.initialisation], self.sensor.max_range, **section.model_dump())

    @model_validator(mode="after")
    def _rays_reach(self) -> Scenario:
        if not self.is_bearing_only:
            return self
        reach = self.sensor.max_range
        try:
            rays = fitted(Rays, reach, **self.fis.model_dump())
        except UserError as error:
            raise invalid(f"fis.{error}") from None
        if rays.s_max < reach:
            what = f"fis.s_max = {rays.s_max} m is shorter than sensor.max_range = {reach} m"
            raise invalid(f"{what}; farther landmarks would be lost")
        return self

    @model_validator(mode="after")
    def _can_associate(self) -> Scenario:
        method = self.association.method
        if self.is_bearing_only and method != "known" and self.initialisation != "fis":
            remedy = 'set initialisation = "fis", or the method "known"'
            raise invalid(f'association.method = "{method}" needs rays; {remedy}')
        return self

    @model_validator(mode="after")
    def _starts_where_its_path_does(self) -> Scenario:
        if not isinstance(self.trajectory, Csv):
            return self
        first = self.trajectory.poses[0]
        if np.abs(between(self.prior.mean, first)).max() > _SAME_POSE:
            what = f"{[*self.prior.mean]} is not where the path of {self.trajectory.file.name} starts"
            raise invalid(f"prior.mean: {what}; set it to {first.tolist()}")
        return self

    @model_validator(mode="after")
    def _odometry_predicts(self) -> Scenario:
        """Refuse odometry that does not predict which landmarks are in view: optima then take minutes."""
        speeds = [self.motion.sigma_speed or 0.0, self.motion.sigma_lateral or 0.0]
        if self.motion.covariances is not None or self.sensor.sights is not None:
            return self
        lasts = float(self.trajectory.durations().max(initial=0.0))
        sigma, reach = max(speeds) * lasts, self.sensor.max_range
        if sigma > reach:
            key = ("sigma_speed", "sigma_lateral")[int(np.argmax(speeds))]
            what = (
                f"a step of {lasts:g} s has a standard deviation of {sigma:g} m, above sensor.max_range ({reach:g} m)"
            )
            raise invalid(f"motion.{key}: {what}; give at most {reach / lasts:g} m/s")
        return self

    @model_validator(mode="after")
    def _tables_fit(self) -> Scenario:
        motion, sights = self.motion.covariances, self.sensor.sights
        if motion is None and sights is None:
            return self
        steps = len(self.trajectory.increments(self.prior.mean))
        if motion is not None and len(covs(motion)) != steps:
            what = f"{motion.name} has {len(covs(motion))} rows for {steps} steps of the path"
            raise invalid(f"motion.covariances: {what}; give one for each")
        for what, column, most in (("step", 0, steps), ("landmark", 1, len(self.landmarks.all()) - 1)):
            if sights is not None and sights[column].max(initial=0) > most:
                value = int(sights[column].max())
                raise invalid(f"sensor.sightings: {what} {value} does not exist; the last one is {most}")
        return self
