"""Noise and bias parameters of a recording.

* Odometry: sigmas of forward, lateral and turn. How the noise varies from step to step is that of the recording,
  Q_k = T_k diag(forward^2, lateral^2, turn^2) T_k' in the body frame at the start of the step. T_k has ones on its
  diagonal, and describes how much of an error appears in another one: a sensor ahead of the robot's centre moves
  sideways when the robot turns. The turn is eliminated first, then lateral, then forward: lateral noise is the part
  that the turn does not explain.
* Observations: D R_i D with D = diag(range, bearing) relative to the assumed sigmas; a position has one sigma for both
  axes.
* Systematic errors, which are removed from the measurements: the odometry is too long by `odometry_scale` and turns too
  far by `turn_per_metre`; ranges and bearings are too large by their offsets. Errors of the odometry are a share of its
  motion averaged over some steps. A share of each increment would be biased by its noise (errors in variables), by
  (noise / motion)^2 of a step, 9 % in the scenarios of the exercise.
* A bearing offset looks like a robot that drives to the right of its heading by the same angle. Therefore headings
  refer to the forward direction of the sensor, or to that of the odometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap
from slamgauge.sensors import SENSORS, inverse, predict

ODOMETRY = ("forward", "lateral", "turn")
POLAR = "range-bearing"
Heading = Literal["sensor", "odometry"]
SYSTEMATIC = ("odometry_scale", "turn_per_metre", "range_offset", "bearing_offset")
UNITS = {
    **dict.fromkeys(("forward", "lateral"), "m per step"),
    "turn": "rad per step",
    **dict.fromkeys(("range", "position", "range_offset"), "m"),
    **dict.fromkeys(("bearing", "bearing_offset"), "rad"),
    "odometry_scale": "1",
    "turn_per_metre": "rad/m",
}
AVERAGED = 51  # steps
START = 0.1  # start of the search for a sigma that the recording does not state, relative to that of forward
PIVOT = 1e-9  # a smaller share of a variance is rounding of its elimination


class OdometryForm(NamedTuple):
    """Variation of N covariances from step to step; columns are forward, lateral and turn."""

    mixing: Float  # (N, 3, 3) T_k
    profile: Float  # (N, 3) sigmas of each step, relative to their root mean square
    assumed: Float  # (3,) root mean squares [m, m, rad per step]

    def covariances(self, sigmas: Float) -> Float:
        """Return covariances (N, 3, 3) of the same form with other sigmas (3,)."""
        mixed = self.mixing * (self.profile * sigmas)[:, None, :]
        return mixed @ mixed.swapaxes(1, 2)


def odometry_form(covs: Float) -> OdometryForm:
    """Return the form of covariances (N, 3, 3); a sigma that is always 0 varies like that of forward, or not at all."""
    turn = covs[:, 2, 2]
    lateral_by_turn, forward_by_turn = _regression(covs[:, 1, 2], turn), _regression(covs[:, 0, 2], turn)
    lateral = _remaining(covs[:, 1, 1], lateral_by_turn**2 * turn)
    forward_by_lateral = _regression(covs[:, 0, 1] - lateral_by_turn * forward_by_turn * turn, lateral)
    forward = _remaining(covs[:, 0, 0], forward_by_turn**2 * turn + forward_by_lateral**2 * lateral)
    mixing = np.tile(np.eye(3), (len(covs), 1, 1))
    mixing[:, 0, 1], mixing[:, 0, 2], mixing[:, 1, 2] = forward_by_lateral, forward_by_turn, lateral_by_turn
    sigmas = np.sqrt(np.column_stack([forward, lateral, turn]))
    assumed = np.sqrt(np.mean(sigmas**2, axis=0)) if len(covs) else np.zeros(3)
    profile = np.ones_like(sigmas)
    for column in range(3):
        source = column if assumed[column] > 0.0 else 0
        if assumed[source] > 0.0:
            profile[:, column] = sigmas[:, source] / assumed[source]
    return OdometryForm(mixing, profile, assumed)


def _regression(shared: Float, variance: Float) -> Float:
    """Return the regression coefficient of one error on another one with `variance`; 0 if this is 0."""
    return np.divide(shared, variance, out=np.zeros_like(shared), where=variance > 0.0)


def _remaining(variance: Float, explained: Float) -> Float:
    """Return the unexplained part of a variance, 0 if it is rounding."""
    left = variance - explained
    return np.where(left > PIVOT * variance, left, 0.0)


class NoiseParameters:
    """Parameters of the noise and the systematic errors of a recording, with or without ids.

    Args:
        recording: `range-bearing` or `position`, with steps and observations.

    Attributes:
        channels: names of the measured quantities.
        sigmas: names of all sigmas.
        assumed: sigmas of the recording by name, root mean squares over its steps and observations.
        begin: start of the search for each sigma.

    Raises:
        UserError: the recording is bearing-only, or has no steps or no observations.
    """

    def __init__(self, recording: Recording) -> None:
        model = SENSORS[recording.sensor]
        if not model.places_landmarks:
            raise UserError(
                "sensor: a bearing-only observation does not place a new landmark; give a recording with ranges, too"
            )
        if not recording.steps or not len(recording.observation):
            raise UserError(
                "recording: it has no steps or no observations, so that no noise can be found; give a longer one"
            )
        self.recording = recording
        self.channels = tuple(dict.fromkeys(model.sigmas))
        self.sigmas = (*ODOMETRY, *self.channels)
        self._form = odometry_form(recording.odometry_cov)
        self._motion: Float = uniform_filter1d(recording.odometry[:, :2], AVERAGED, axis=0, mode="nearest")
        self._distance = np.hypot(self._motion[:, 0], self._motion[:, 1])
        variances = np.diagonal(recording.observation_cov, axis1=1, axis2=2).reshape(-1, len(self.channels))
        sensor = np.sqrt(variances.mean(axis=0))
        self.assumed = dict(zip(self.sigmas, [*self._form.assumed.tolist(), *sensor.tolist()], strict=True))
        start = START * (self.assumed["forward"] or self.assumed[self.channels[0]])
        self.begin = {name: self.assumed[name] or start for name in self.sigmas}

    def measurements(self, values: Mapping[str, float]) -> tuple[Float, Float, Float, Float]:
        """Return odometry and observations, each with its covariances, for the values of all parameters."""
        odometry, observation = self.recording.odometry, self.recording.observation
        if SYSTEMATIC[0] in values:
            odometry, observation = self._corrected(values)
        odometry_cov = self._form.covariances(np.array([values[name] for name in ODOMETRY]))
        factor = np.broadcast_to([values[name] / self.assumed[name] for name in self.channels], 2)
        return odometry, odometry_cov, observation, self.recording.observation_cov * np.outer(factor, factor)

    def rows(self, channel: str) -> list[int]:
        """Return which of the two rows of an observation belong to a channel."""
        return [0, 1] if len(self.channels) == 1 else [self.channels.index(channel)]

    def recording_with(self, values: Mapping[str, float], heading: Heading = "odometry") -> Recording:
        """Return the recording with these values; its headings refer to the forward direction of `heading`.

        For the sensor's direction, bearings are unchanged, and increments and their noise are rotated by the offset.
        """
        offset = values.get("bearing_offset", 0.0)
        is_turned = heading == "sensor" and offset != 0.0
        odometry, odometry_cov, observation, observation_cov = self.measurements(
            {**values, "bearing_offset": 0.0} if is_turned else values
        )
        if is_turned:
            turn = np.eye(3)
            turn[:2, :2] = rotation(offset)
            odometry, odometry_cov = odometry @ turn.T, turn @ odometry_cov @ turn.T
        found = {"odometry": odometry, "odometry_cov": odometry_cov}
        return replace(self.recording, **found, observation=observation, observation_cov=observation_cov)

    def _corrected(self, values: Mapping[str, float]) -> tuple[Float, Float]:
        """Return increments (N, 3) and observations (M, 2) without systematic errors."""
        odometry, observation = self.recording.odometry.copy(), self.recording.observation
        scale = values["odometry_scale"]
        odometry[:, :2] -= scale / (1.0 + scale) * self._motion
        odometry[:, 2] -= values["turn_per_metre"] * self._distance / (1.0 + scale)
        sensor = self.recording.sensor
        distance, bearing = (observation if sensor == POLAR else predict(POLAR, inverse(sensor, observation))).T
        distance = np.maximum(distance - values["range_offset"], 0.0)
        polar = np.column_stack([distance, wrap(bearing - values["bearing_offset"])])
        return odometry, polar if sensor == POLAR else predict(sensor, inverse(POLAR, polar))
