"""The schema of scenario files: every section, its keys and their units."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.measurement_errors import Motion, Sensor
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

_TRIES = 1000  # random positions tried for a landmark
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
        if value is not None:
            as_covariances("covariance", value, (3, 3))
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


class RandomLandmarks(Section, frozen=True):
    """`count` landmarks, uniform in the `box` (x from, y from, x to, y to) [m], at least `min_distance` [m] apart.

    `seed` is the seed of the map: all runs have the same map.
    """

    count: Annotated[Whole, Field(ge=1, le=100_000)]
    box: tuple[Number, Number, Number, Number]
    seed: Annotated[Whole, Field(ge=0)] = 0
    min_distance: NonNegative = 0.0

    @model_validator(mode="after")
    def _has_room(self) -> RandomLandmarks:
        if not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise invalid("box is empty; give [x from, y from, x to, y to]")
        placed = len(_scattered(self))
        if placed < self.count:
            what = f"only {placed} of {self.count} landmarks fit at min_distance = {self.min_distance}"
            raise invalid(f"{what}; lower it or enlarge the box")
        return self


@lru_cache(maxsize=16)
def _scattered(chosen: RandomLandmarks) -> Float:
    """Return positions (count, 2) [m]; fewer if they do not fit."""
    generator = np.random.default_rng(chosen.seed)
    low, high = np.array(chosen.box[:2]), np.array(chosen.box[2:])
    if chosen.min_distance == 0.0:
        positions = generator.uniform(low, high, (chosen.count, 2))
    else:
        positions, tries = np.empty((0, 2)), _TRIES
        while len(positions) < chosen.count and tries:
            place, tries = generator.uniform(low, high), tries - 1
            if not (np.hypot(*(positions - place).T) < chosen.min_distance).any():
                positions, tries = np.vstack([positions, place]), _TRIES
    positions.setflags(write=False)
    return positions


class Landmarks(Section):
    """The map: `positions` of the landmarks, (x, y) [m], or `random` ones."""

    positions: tuple[tuple[Number, Number], ...] = ()
    random: RandomLandmarks | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Landmarks:
        if self.random is not None and self.positions:
            raise invalid("has both forms; give positions, or random")
        if self.random is None and "positions" not in self.model_fields_set:
            raise invalid("has no landmarks; give positions ([] for none), or random")
        return self

    def all(self) -> Float:
        """Return the positions (L, 2) of all landmarks [m]."""
        if self.random is not None:
            return _scattered(self.random)
        return np.array(self.positions, dtype=np.float64).reshape(-1, 2)


class Scenario(Section):
    """A simulated run without its seed; `start` is the true start pose, sampled from the prior or the prior's mean."""

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
        section: Section = getattr(self, self.initialisation)
        return fitted(INITIALISATIONS[self.initialisation], self.sensor.max_range, **section.model_dump())

    @model_validator(mode="after")
    def _fits_together(self) -> Scenario:
        if self.is_bearing_only:
            self._require_rays()
        if self.motion.covs is None and self.sensor.sights is None:
            self._require_prediction()
        path, motion, sights = self.trajectory, self.motion.covs, self.sensor.sights
        if isinstance(path, Csv) and np.abs(between(self.prior.mean, path.poses[0])).max() > _SAME_POSE:
            what = f"{[*self.prior.mean]} is not where the path of {path.file.name} starts"
            raise invalid(f"prior.mean: {what}; set it to {path.poses[0].tolist()}")
        if motion is None and sights is None:
            return self
        steps = len(path.increments(self.prior.mean))
        if motion is not None and self.motion.covariances is not None and len(motion) != steps:
            what = f"{self.motion.covariances.name} has {len(motion)} rows for {steps} steps of the path"
            raise invalid(f"motion.covariances: {what}; give one for each")
        for what, column, most in (("step", 0, steps), ("landmark", 1, len(self.landmarks.all()) - 1)):
            if sights is not None and sights[column].max(initial=0) > most:
                value = int(sights[column].max())
                raise invalid(f"sensor.sightings: {what} {value} does not exist; the last one is {most}")
        return self

    def _require_rays(self) -> None:
        """Refuse rays that do not reach as far as the sensor, and association of bearings without rays."""
        reach, method = self.sensor.max_range, self.association.method
        try:
            rays = fitted(Rays, reach, **self.fis.model_dump())
        except UserError as error:
            raise invalid(f"fis.{error}") from None
        if rays.s_max < reach:
            what = f"fis.s_max = {rays.s_max} m is shorter than sensor.max_range = {reach} m"
            raise invalid(f"{what}; farther landmarks would be lost")
        if method != "known" and self.initialisation != "fis":
            remedy = 'set initialisation = "fis", or the method "known"'
            raise invalid(f'association.method = "{method}" needs rays; {remedy}')

    def _require_prediction(self) -> None:
        """Refuse odometry that does not predict which landmarks are in view: optima then take minutes."""
        lasts, reach = float(self.trajectory.durations.max(initial=0.0)), self.sensor.max_range
        sigma, key = max((getattr(self.motion, key) or 0.0, key) for key in ("sigma_speed", "sigma_lateral"))
        if sigma * lasts > reach:
            what = f"a step of {lasts:g} s has a standard deviation of {sigma * lasts:g} m"
            limit = f"above sensor.max_range ({reach:g} m); give at most {reach / lasts:g} m/s"
            raise invalid(f"motion.{key}: {what}, {limit}")
