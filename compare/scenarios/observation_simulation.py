"""Simulated observations on a path: landmarks in view, with noise, outliers and clutter.

Every kind of draw has its own generator, and within it every landmark, so that no option and no added landmark changes
other draws. Sightings of a file are drawn in sequence: there a landmark may be observed twice in a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from slamgauge.arrays import CHUNK, Float, Int, Marks, chunks
from slamgauge.compare.scenarios.measurement_errors import Sensor
from slamgauge.covariances import square_roots
from slamgauge.memory import require_memory
from slamgauge.se2 import in_body, wrap
from slamgauge.sensors import SENSORS, predict
from slamgauge.truth import NOBODY

POSE, SIGHT = 300, 64  # bytes for a pose and for an observation during simulation
SHORTER = "shorten trajectory.duration"
WIDE = 10.0  # noise of a `wide` outlier divided by that of other observations


class Streams(NamedTuple):
    """A random stream for each kind of draw."""

    noise: np.random.SeedSequence
    detection: np.random.SeedSequence
    outlier: np.random.SeedSequence
    wrong_value: np.random.SeedSequence
    clutter: np.random.SeedSequence
    clutter_value: np.random.SeedSequence


class Observed(NamedTuple):
    """Observations in the order of steps; in each step clutter is last."""

    step: Int  # (M,)
    landmark: Int  # (M,) number of the landmark; NOBODY for clutter
    value: Float  # (M, d)
    cov: Float  # (M, d, d) covariance of the noise
    outlier: Marks  # (M,)


@dataclass(frozen=True)
class _Sights:
    """Step (M,) and landmark (M,) of each observation, and the numbers of all steps and landmarks."""

    step: Int
    landmark: Int
    steps: int
    landmarks: int
    of_a_file: bool

    def draw(self, stream: np.random.SeedSequence, kind: Literal["standard_normal", "random"], width: int) -> Float:
        """Return random numbers (M, width) for the observations."""
        if self.of_a_file:
            return getattr(np.random.default_rng(stream), kind)((len(self.step), width))
        drawn = np.empty((len(self.step), width))
        small = self.landmark.astype(np.min_scalar_type(self.landmarks))  # numpy sorts small integers fast
        ends = np.cumsum(np.bincount(small, minlength=self.landmarks))
        of_each = np.split(np.argsort(small, kind="stable"), ends)[:-1]
        for landmark, sights in enumerate(of_each):
            if len(sights):  # the child that `stream.spawn` would return, which is slow for landmarks out of view
                child = np.random.SeedSequence(stream.entropy, spawn_key=(*stream.spawn_key, landmark))
                every = getattr(np.random.default_rng(child), kind)((self.steps, width))
                drawn[sights] = every[self.step[sights]]
        return drawn


def observe(poses: Float, landmarks: Float, sensor: Sensor, streams: Streams) -> Observed:
    """Simulate the observations of landmarks (L, 2) from poses (N+1, 3)."""
    sights = _sights(poses, landmarks, sensor)
    value = _noise(sensor, sights, streams.noise)
    count = len(value)
    for rows in chunks(count):
        seen = in_body(poses[sights.step[rows]], landmarks[sights.landmark[rows]])
        value[rows] = _measured(seen, value[rows], sensor)
    outlier = np.zeros(count, dtype=np.bool_)
    if sensor.outlier_rate > 0.0:
        outlier = sights.draw(streams.outlier, "random", 1)[:, 0] < sensor.outlier_rate
        seen = in_body(poses[sights.step[outlier]], landmarks[sights.landmark[outlier]])
        value[outlier] = _wrong(seen, sights, outlier, sensor, streams)
    found = Observed(sights.step, sights.landmark, value, _covs(sensor, count), outlier)
    if sensor.detection_probability < 1.0:
        seen = sights.draw(streams.detection, "random", 1)[:, 0] < sensor.detection_probability
        covs = _covs(sensor, int(seen.sum())) if sensor.covs is None else sensor.covs[seen]
        found = Observed(sights.step[seen], sights.landmark[seen], value[seen], covs, outlier[seen])
    return _with_clutter(found, len(poses), sensor, streams) if sensor.clutter_rate > 0.0 else found


def _sights(poses: Float, landmarks: Float, sensor: Sensor) -> _Sights:
    steps, count = len(poses), len(landmarks)
    if sensor.sights is not None:
        return _Sights(*sensor.sights, steps, count, of_a_file=True)
    require_memory(1.0 * steps * (count + POSE), f"a run of {steps - 1} steps among {count} landmarks", SHORTER)
    in_view = np.zeros((steps, count), dtype=np.bool_)
    together = max(CHUNK // max(count, 1), 1)
    for first in range(sensor.first_step, steps, together):
        in_view[first : first + together] = _in_view(in_body(poses[first : first + together, None], landmarks), sensor)
    seen = int(np.count_nonzero(in_view))
    require_memory(1.0 * seen * SIGHT, f"a run of {seen} observations", f"{SHORTER}, or lower sensor.max_range")
    step, landmark = np.divmod(np.flatnonzero(in_view), max(count, 1))
    return _Sights(step, landmark, steps, count, of_a_file=False)


def _in_view(body: Float, sensor: Sensor) -> Marks:
    """Return which points (..., 2) of the body frame are in view (...)."""
    distance = np.linalg.norm(body, axis=-1)
    in_view = (sensor.min_range <= distance) & (distance <= sensor.max_range)
    if sensor.field_of_view_deg < 360.0:
        in_view &= np.abs(np.arctan2(body[..., 1], body[..., 0])) <= np.deg2rad(sensor.field_of_view_deg / 2.0)
    return in_view


def _noise(sensor: Sensor, sights: _Sights, stream: np.random.SeedSequence) -> Float:
    """Draw the noise (M, d)."""
    if sensor.covs is not None:
        unit = sights.draw(stream, "standard_normal", sensor.covs.shape[1])
        return np.einsum("mij,mj->mi", square_roots(sensor.covs), unit)
    noise = sights.draw(stream, "standard_normal", len(sensor.sigmas))
    noise *= sensor.sigmas
    return noise


def _covs(sensor: Sensor, count: int) -> Float:
    """Return the covariances (M, d, d) of the noise."""
    if sensor.covs is not None:
        return sensor.covs
    return np.broadcast_to(np.diag(sensor.sigmas**2), (count, len(sensor.sigmas), len(sensor.sigmas)))


def _measured(body: Float, noise: Float, sensor: Sensor) -> Float:
    """Return the observations (M, d) of points (M, 2) in the body frame with noise (M, d)."""
    model, value = SENSORS[sensor.kind], predict(sensor.kind, body)
    if model.has_range:
        value[:, 0] = np.linalg.norm(body, axis=1)  # same rounding as in older versions: same recordings
    value = value + noise
    for column in np.flatnonzero(model.is_angle):
        value[:, column] = wrap(value[:, column])
    if model.has_range:
        value[:, 0] = np.abs(value[:, 0])  # a sensor measures no negative range
    return value


def _wrong(body: Float, sights: _Sights, outlier: Marks, sensor: Sensor, streams: Streams) -> Float:
    """Return the values (m, d) of outliers for points (m, 2)."""
    if sensor.outlier == "wide":
        return _measured(body, WIDE * _noise(sensor, sights, streams.wrong_value)[outlier], sensor)
    return _anywhere(sights.draw(streams.wrong_value, "random", 2)[outlier], sensor)


def _anywhere(draws: Float, sensor: Sensor) -> Float:
    """Return values (M, d) uniform in range and bearing over the field of view, from uniform draws (M, 2)."""
    ranges = sensor.min_range + (sensor.max_range - sensor.min_range) * draws[:, 0]
    bearings = np.deg2rad(sensor.field_of_view_deg) * (draws[:, 1] - 0.5)
    points = ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return _measured(points, np.zeros((len(draws), SENSORS[sensor.kind].dim)), sensor)


def _with_clutter(found: Observed, steps: int, sensor: Sensor, streams: Streams) -> Observed:
    """Add clutter to observations."""
    count = np.random.default_rng(streams.clutter).poisson(sensor.clutter_rate, steps)
    count[: sensor.first_step] = 0
    step = np.repeat(np.arange(steps), count)
    value = _anywhere(np.random.default_rng(streams.clutter_value).random((len(step), 2)), sensor)
    order = np.argsort(np.concatenate([found.step, step]), kind="stable")
    cov = _covs(sensor, len(order))
    if sensor.covs is not None:  # clutter has the mean covariance of the sightings
        mean = np.broadcast_to(sensor.covs.mean(axis=0), (len(step), *2 * value.shape[1:]))
        cov = np.concatenate([found.cov, mean])[order]
    return Observed(
        step=np.concatenate([found.step, step])[order],
        landmark=np.concatenate([found.landmark, np.full(len(step), NOBODY)])[order],
        value=np.concatenate([found.value, value])[order],
        cov=cov,
        outlier=np.concatenate([found.outlier, np.zeros(len(step), dtype=np.bool_)])[order],
    )
