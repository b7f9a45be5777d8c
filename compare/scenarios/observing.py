"""What the sensor reports on a path: what is in view, with noise, outliers and clutter.

Every kind of draw has a generator of its own, and within it every landmark, so that no option, and no landmark that is
added, changes what is drawn elsewhere. Sightings of a file draw one after the other: there a landmark may be seen twice
in a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.scenarios.sensor import Sensor
from slamgauge.correlations import square_roots
from slamgauge.se2 import rotation, wrap
from slamgauge.truth import NOBODY

WIDE = 10.0  # noise of a `wide` outlier over that of other observations


class Streams(NamedTuple):
    """Where the random numbers of each kind come from."""

    noise: np.random.SeedSequence
    detection: np.random.SeedSequence
    outlier: np.random.SeedSequence
    wrong_value: np.random.SeedSequence
    clutter: np.random.SeedSequence
    clutter_value: np.random.SeedSequence


class Observed(NamedTuple):
    """Observations in the order of steps, in each those of landmarks before clutter."""

    step: Int  # (M,)
    landmark: Int  # (M,) number of the landmark; NOBODY for clutter
    value: Float  # (M, d)
    cov: Float  # (M, d, d) of the noise, which estimators are told
    outlier: Marks  # (M,)


@dataclass(frozen=True)
class _Sights:
    """Which landmark (M,) is in view at which step (M,), and of how many steps and landmarks."""

    step: Int
    landmark: Int
    steps: int
    landmarks: int
    of_a_file: bool

    def draw(self, stream: np.random.SeedSequence, kind: Literal["standard_normal", "random"], width: int) -> Float:
        """Random numbers (M, width), for each sight its own."""
        if self.of_a_file:
            return getattr(np.random.default_rng(stream), kind)((len(self.step), width))
        drawn = np.empty((self.steps, self.landmarks, width))
        for landmark, child in enumerate(stream.spawn(self.landmarks)):
            drawn[:, landmark] = getattr(np.random.default_rng(child), kind)((self.steps, width))
        return drawn[self.step, self.landmark]


def observe(poses: Float, landmarks: Float, sensor: Sensor, streams: Streams) -> Observed:
    """What is reported of the landmarks (L, 2) from the poses (N+1, 3)."""
    sights = _sights(poses, landmarks, sensor)
    body = _in_body(poses[sights.step], landmarks[sights.landmark])
    value = _measured(body, _noise(sensor, sights, streams.noise), sensor)
    outlier, seen = np.zeros(len(value), dtype=np.bool_), np.ones(len(value), dtype=np.bool_)
    if sensor.outlier_rate > 0.0:
        outlier = sights.draw(streams.outlier, "random", 1)[:, 0] < sensor.outlier_rate
        value = np.where(outlier[:, None], _wrong(body, sights, sensor, streams.wrong_value), value)
    if sensor.detection_probability < 1.0:
        seen = sights.draw(streams.detection, "random", 1)[:, 0] < sensor.detection_probability
    cov = _covs(sensor, len(value))
    found = Observed(sights.step[seen], sights.landmark[seen], value[seen], cov[seen], outlier[seen])
    return _with_clutter(found, len(poses), sensor, streams) if sensor.clutter_rate > 0.0 else found


def _sights(poses: Float, landmarks: Float, sensor: Sensor) -> _Sights:
    if sensor.sights is not None:
        return _Sights(*sensor.sights, len(poses), len(landmarks), of_a_file=True)
    body = _in_body(poses[:, None], landmarks)
    distance = np.linalg.norm(body, axis=2)
    in_view = (sensor.min_range <= distance) & (distance <= sensor.max_range)
    if sensor.field_of_view_deg < 360.0:
        in_view &= np.abs(np.arctan2(body[:, :, 1], body[:, :, 0])) <= np.deg2rad(sensor.field_of_view_deg / 2.0)
    in_view[: sensor.first_step] = False
    step, landmark = np.nonzero(in_view)
    return _Sights(step, landmark, len(poses), len(landmarks), of_a_file=False)


def _in_body(poses: Float, points: Float) -> Float:
    """Points (..., 2) of the world in the body frames of poses (..., 3)."""
    return np.einsum("...ji,...j->...i", rotation(poses[..., 2]), points - poses[..., :2])


def _noise(sensor: Sensor, sights: _Sights, stream: np.random.SeedSequence) -> Float:
    """Noise (M, d) of the stated size."""
    if sensor.covs is not None:
        unit = sights.draw(stream, "standard_normal", sensor.covs.shape[1])
        return np.einsum("mij,mj->mi", square_roots(sensor.covs), unit)
    return sensor.sigmas * sights.draw(stream, "standard_normal", len(sensor.sigmas))


def _covs(sensor: Sensor, count: int) -> Float:
    """Covariances (M, d, d) of the noise."""
    if sensor.covs is not None:
        return sensor.covs
    return np.broadcast_to(np.diag(sensor.sigmas**2), (count, len(sensor.sigmas), len(sensor.sigmas)))


def _measured(body: Float, noise: Float, sensor: Sensor) -> Float:
    """What the sensor makes (M, d) of points (M, 2) in the body frame, and noise (M, d)."""
    if sensor.kind == "position":
        return body + noise
    bearings = np.arctan2(body[:, 1], body[:, 0]) + noise[:, -1]
    if sensor.kind == "bearing":
        return wrap(bearings)[:, None]
    ranges = np.linalg.norm(body, axis=1) + noise[:, 0]
    # no sensor reports a negative range: noise that reaches past zero is reflected
    return np.column_stack([np.abs(ranges), wrap(bearings)])


def _wrong(body: Float, sights: _Sights, sensor: Sensor, stream: np.random.SeedSequence) -> Float:
    """The values (M, d) that outliers have."""
    if sensor.outlier == "wide":
        return _measured(body, WIDE * _noise(sensor, sights, stream), sensor)
    return _anywhere(sights.draw(stream, "random", 2), sensor)


def _anywhere(draws: Float, sensor: Sensor) -> Float:
    """Values (M, d) uniform in range and direction over what the sensor sees, from uniform draws (M, 2)."""
    ranges = sensor.min_range + (sensor.max_range - sensor.min_range) * draws[:, 0]
    bearings = np.deg2rad(sensor.field_of_view_deg) * (draws[:, 1] - 0.5)
    points = ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return _measured(points, np.zeros((len(draws), 2)), sensor)


def _with_clutter(found: Observed, steps: int, sensor: Sensor, streams: Streams) -> Observed:
    """The observations, and those of nothing."""
    count = np.random.default_rng(streams.clutter).poisson(sensor.clutter_rate, steps)
    count[: sensor.first_step] = 0
    step = np.repeat(np.arange(steps), count)
    value = _anywhere(np.random.default_rng(streams.clutter_value).random((len(step), 2)), sensor)
    # of sightings with covariances of their own clutter has the mean
    cov = np.broadcast_to(_covs(sensor, 1).mean(axis=0), (len(step), *2 * value.shape[1:]))
    order = np.argsort(np.concatenate([found.step, step]), kind="stable")
    return Observed(
        step=np.concatenate([found.step, step])[order],
        landmark=np.concatenate([found.landmark, np.full(len(step), NOBODY)])[order],
        value=np.concatenate([found.value, value])[order],
        cov=np.concatenate([found.cov, cov])[order],
        outlier=np.concatenate([found.outlier, np.zeros(len(step), dtype=np.bool_)])[order],
    )
