"""What is told of a recording: which noise it has, and which systematic errors.

* Odometry: sigmas of forward, lateral and turn, in the form that the recording gives them (see `odometry_form`).
* Observations: D R_i D with D = diag(range, bearing) over what is assumed; one sigma for both axes of a position.
* Systematic errors, which are taken out of the measurements: the odometry is too long by `odometry_scale`, turns too
  far by `turn_per_metre`, ranges and bearings are too large by their offsets. What the odometry has of them is a share
  of its motion averaged over some steps: a share of each increment would be one of its noise, too, and such a scale
  comes out wrong by (noise / motion)^2 of a step, 9 % in the practical's scenarios (errors in variables).
* Bearings that are too large by an offset and a robot that drives that much to the right of its heading are one and
  the same: a heading is the sensor's straight ahead, or the odometry's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from slamgauge.arrays import Float
from slamgauge.compare.noise.odometry_form import odometry_form
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap
from slamgauge.sensors import SENSORS, inverse, predict

ODOMETRY = ("forward", "lateral", "turn")
POLAR = "range-bearing"
Heading = Literal["sensor", "odometry"]
SYSTEMATIC = ("odometry_scale", "turn_per_metre", "range_offset", "bearing_offset")
UNITS = {
    "forward": "m per step",
    "lateral": "m per step",
    "turn": "rad per step",
    "range": "m",
    "bearing": "rad",
    "position": "m",
    "odometry_scale": "1",
    "turn_per_metre": "rad/m",
    "range_offset": "m",
    "bearing_offset": "rad",
}
AVERAGED = 51  # steps
LENT = 0.1  # of forward's sigma: where the search for a sigma begins of which the recording states nothing


class Measurements(NamedTuple):
    """What a recording measured, with the noise that is told of it; fields as in `Recording`."""

    odometry: Float
    odometry_cov: Float
    observation: Float
    observation_cov: Float


class Told:
    """What can be told of a recording's noise, and of its systematic errors: ids are not needed for that.

    Args:
        recording: `range-bearing` or `position`, with steps and observations.

    Attributes:
        channels: of the sensor.
        sigmas: names of all sigmas.
        assumed: the recording's own by name, root mean squares over its steps and observations.
        begin: what the search for each begins with.

    Raises:
        UserError: the recording has bearings alone, no steps or no observations.
    """

    def __init__(self, recording: Recording) -> None:
        model = SENSORS[recording.sensor]
        if not model.places_landmarks:
            reason = "bearings alone place no landmark at first sight, and so have no innovations there"
            raise UserError(f"sensor: {reason}; give a recording with ranges, too")
        if not recording.steps or not len(recording.observation):
            raise UserError("recording: without steps or without observations it tells no noise; give a longer one")
        self.recording = recording
        self.channels = tuple(dict.fromkeys(model.sigmas))
        self.sigmas = (*ODOMETRY, *self.channels)
        self._form = odometry_form(recording.odometry_cov)
        self._motion: Float = uniform_filter1d(recording.odometry[:, :2], AVERAGED, axis=0, mode="nearest")
        self._distance = np.hypot(self._motion[:, 0], self._motion[:, 1])
        variances = np.diagonal(recording.observation_cov, axis1=1, axis2=2).reshape(-1, len(self.channels))
        sensor = np.sqrt(variances.mean(axis=0))
        self.assumed = dict(zip(self.sigmas, [*self._form.assumed.tolist(), *sensor.tolist()], strict=True))
        lent = LENT * (self.assumed["forward"] or self.assumed[self.channels[0]])
        self.begin = {name: self.assumed[name] or lent for name in self.sigmas}

    def measurements(self, values: Mapping[str, float]) -> Measurements:
        """What was measured, less the systematic errors among `values`, with the sigmas there."""
        odometry, observation = self.recording.odometry, self.recording.observation
        if SYSTEMATIC[0] in values:
            odometry, observation = self._corrected(values)
        odometry_cov = self._form.covariances(np.array([values[name] for name in ODOMETRY]))
        factor = np.broadcast_to([values[name] / self.assumed[name] for name in self.channels], 2)
        return Measurements(
            odometry, odometry_cov, observation, self.recording.observation_cov * np.outer(factor, factor)
        )

    def under(self, values: Mapping[str, float], heading: Heading = "odometry") -> Recording:
        """The recording of these measurements; `heading` says whose straight ahead its headings are.

        Under the sensor's, bearings stay as they are, and increments and their noise are turned by the offset.
        """
        offset = values.get("bearing_offset", 0.0)
        if heading == "odometry" or offset == 0.0:
            return replace(self.recording, **self.measurements(values)._asdict())
        measured = self.measurements({**values, "bearing_offset": 0.0})
        turn = np.eye(3)
        turn[:2, :2] = rotation(offset)
        odometry = measured.odometry @ turn.T
        turned = measured._replace(odometry=odometry, odometry_cov=turn @ measured.odometry_cov @ turn.T)
        return replace(self.recording, **turned._asdict())

    def _corrected(self, values: Mapping[str, float]) -> tuple[Float, Float]:
        """Increments and observations without systematic errors."""
        odometry, observation = self.recording.odometry.copy(), self.recording.observation
        scale = values["odometry_scale"]
        odometry[:, :2] -= scale / (1.0 + scale) * self._motion
        odometry[:, 2] -= values["turn_per_metre"] * self._distance / (1.0 + scale)
        sensor = self.recording.sensor
        distance, bearing = (observation if sensor == POLAR else predict(POLAR, inverse(sensor, observation))).T
        distance = np.maximum(distance - values["range_offset"], 0.0)
        polar = np.column_stack([distance, wrap(bearing - values["bearing_offset"])])
        return odometry, polar if sensor == POLAR else predict(sensor, inverse(POLAR, polar))
