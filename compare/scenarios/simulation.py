"""Simulation of a scenario: the true path, the odometry and the observations of one seed.

Every kind of draw has its own generator, and that of observations one for each landmark, so that no option and no added
landmark changes other draws. Sightings of a file are drawn in sequence: there a landmark may be seen twice in a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from slamgauge.arrays import CHUNK, Float, Int, Marks, chunks, freeze
from slamgauge.compare.scenarios.measurement_errors import Sensor
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario
from slamgauge.compare.scenarios.schema import Association, Assumed, Delayed, Fis, Update
from slamgauge.covariances import square_roots
from slamgauge.errors import UserError
from slamgauge.memory import require_memory
from slamgauge.recording import Recording
from slamgauge.se2 import chain, in_body, wrap
from slamgauge.sensors import SENSORS, predict
from slamgauge.truth import NOBODY, Truth

POSE, SIGHT = 300, 64  # bytes for a pose and for an observation during simulation
SHORTER = "shorten trajectory.duration"
WIDE = 10.0  # noise of a `wide` outlier divided by that of other observations


def simulate(scenario: Scenario | str | Path, seed: int) -> tuple[Truth, Recording]:
    """Simulate one run of a scenario (a shipped name, a TOML file or a `Scenario`): its truth, and its recording.

    The truth follows the commanded increments exactly; the odometry is the command with errors and noise. Every kind
    of draw has its own random stream: a change of the map does not change the odometry, and no option changes the
    draws of another.

    Raises:
        UserError: the seed is not a whole number >= 0.
    """
    truth, recording, _ = simulate_informed(as_scenario(scenario), seed)
    return truth, recording


def simulate_informed(scenario: Scenario, seed: int) -> tuple[Truth, Recording, Recording]:
    """Simulate one run: truth, recording for estimators, and recording for the optima (see `informed`)."""
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise UserError(f"seed: {seed!r} is not valid; use a whole number >= 0")
    start_stream, motion_stream, noise, slip_stream, *others = np.random.SeedSequence(seed).spawn(9)
    trajectory, sensor, start = scenario.trajectory, scenario.sensor, scenario.prior.mean
    command = trajectory.increments(start)
    poses, landmarks = chain(_start(scenario, start_stream), command), scenario.landmarks.all()
    seen = _observe(poses, landmarks, sensor, (noise, *others))
    slips = np.random.default_rng(slip_stream).random((2, len(command)))
    motion_noise, odometry_cov = _motion_noise(scenario, len(command), motion_stream)
    odometry = scenario.motion.misread(command, *slips) + motion_noise
    freeze(poses, odometry, seen.step, seen.landmark, seen.value)  # records share them
    truth = Truth(
        poses=poses,
        landmark_ids=np.arange(len(landmarks)),
        landmarks=landmarks,
        association=seen.landmark,
        outlier=seen.outlier if sensor.outlier_rate > 0.0 else None,
    )
    clutter = seen.landmark == NOBODY  # in the recording each has a new id
    new_ids = np.where(clutter, len(landmarks) - 1 + np.cumsum(clutter), seen.landmark)
    exact = Recording(
        stamps=trajectory.stamps(start),
        prior_mean=np.array(start),
        prior_cov=scenario.prior.cov,
        odometry=odometry,
        odometry_cov=odometry_cov,
        sensor=sensor.kind,
        observation_step=seen.step,
        observation=seen.value,
        observation_cov=seen.cov,
        landmark=new_ids if clutter.any() else seen.landmark,
    )
    assumed = scenario.assumed
    recording = replace(
        exact,
        odometry_cov=_scaled(odometry_cov, assumed.scale * assumed.motion_scale),
        observation_cov=_scaled(seen.cov, assumed.scale * assumed.sensor_scale),
        landmark=exact.landmark if scenario.association.method == "known" else None,
    )
    return truth, recording, exact


def _scaled(covs: Float, factor: float) -> Float:
    """Return covariances (n, d, d) times a factor; a broadcast one is multiplied once."""
    if len(covs) and covs.strides[0] == 0:
        return np.broadcast_to(factor * covs[0], covs.shape)
    return factor * covs


def _motion_noise(scenario: Scenario, steps: int, stream: np.random.SeedSequence) -> tuple[Float, Float]:
    """Return the noise (N, 3) of the increments [m, m, rad], and its covariances (N, 3, 3)."""
    covs, drawn = scenario.motion.covs, np.random.default_rng(stream).standard_normal((steps, 3))
    if covs is not None:
        return np.einsum("nij,nj->ni", square_roots(covs), drawn), covs
    sigmas = scenario.motion.sigmas(scenario.trajectory.durations)
    return sigmas * drawn, np.broadcast_to(sigmas[..., None] ** 2 * np.eye(3), (steps, 3, 3))


def informed(scenario: Scenario) -> Scenario:
    """Return the scenario for the optima: the same measurements, with true noise and known association.

    It is equal for all scenarios with the same measurements.
    """
    default = {"assumed": Assumed(), "association": Association(), "update": Update(), "initialisation": "fis"}
    default |= {"fis": Fis(), "delayed": Delayed()}
    return scenario.model_copy(update={"name": "optimum", "description": "", **default})


def _start(scenario: Scenario, stream: np.random.SeedSequence) -> Float:
    """Return the true start pose (3,): the prior's mean, or drawn from the prior."""
    mean, prior = np.array(scenario.prior.mean), scenario.prior
    if scenario.start == "mean":
        return mean
    drawn = np.random.default_rng(stream).standard_normal(3)
    if prior.covariance is not None:
        return mean + square_roots(prior.cov[None])[0] @ drawn
    return mean + np.sqrt(prior.variances) * drawn


# --- observations ------------------------------------------------------------------------------


class _Observed(NamedTuple):
    """Observations in the order of steps; in each step clutter is last, with the mean covariance of a file."""

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


def _observe(poses: Float, landmarks: Float, sensor: Sensor, streams: Sequence[np.random.SeedSequence]) -> _Observed:
    """Simulate the observations of landmarks (L, 2) from poses (N+1, 3), with a random stream for each kind of draw."""
    noises, detections, outliers, wrong_values, clutters, clutter_values = streams
    sights = _sights(poses, landmarks, sensor)
    step, landmark, value = sights.step, sights.landmark, _noise(sensor, sights, noises)
    source = np.arange(len(value))  # row of `sensor.covs`
    for rows in chunks(len(value)):
        value[rows] = _measured(in_body(poses[step[rows]], landmarks[landmark[rows]]), value[rows], sensor)
    outlier = np.zeros(len(value), dtype=np.bool_)
    if sensor.outlier_rate > 0.0:
        outlier = sights.draw(outliers, "random", 1)[:, 0] < sensor.outlier_rate
        if sensor.outlier == "wide":
            body = in_body(poses[step[outlier]], landmarks[landmark[outlier]])
            value[outlier] = _measured(body, WIDE * _noise(sensor, sights, wrong_values)[outlier], sensor)
        else:
            value[outlier] = _anywhere(sights.draw(wrong_values, "random", 2)[outlier], sensor)
    if sensor.detection_probability < 1.0:
        seen = sights.draw(detections, "random", 1)[:, 0] < sensor.detection_probability
        step, landmark, value, outlier, source = step[seen], landmark[seen], value[seen], outlier[seen], source[seen]
    if sensor.clutter_rate > 0.0:
        count = np.random.default_rng(clutters).poisson(sensor.clutter_rate, len(poses))
        count[: sensor.first_step] = 0
        added = np.repeat(np.arange(len(poses)), count)
        values = _anywhere(np.random.default_rng(clutter_values).random((len(added), 2)), sensor)
        order = np.argsort(np.concatenate([step, added]), kind="stable")
        step, value = np.concatenate([step, added])[order], np.concatenate([value, values])[order]
        nobody = np.full(len(added), NOBODY)
        landmark, source = np.concatenate([landmark, nobody])[order], np.concatenate([source, nobody])[order]
        outlier = np.concatenate([outlier, np.zeros(len(added), dtype=np.bool_)])[order]
    if sensor.covs is None:
        cov = np.broadcast_to(np.diag(sensor.sigmas**2), (len(step), len(sensor.sigmas), len(sensor.sigmas)))
    else:
        cov = np.concatenate([sensor.covs, sensor.covs.mean(axis=0)[None]])[source]  # clutter has the mean
    return _Observed(step, landmark, value, cov, outlier)


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


def _anywhere(draws: Float, sensor: Sensor) -> Float:
    """Return values (M, d) uniform in range and bearing over the field of view, from uniform draws (M, 2)."""
    ranges = sensor.min_range + (sensor.max_range - sensor.min_range) * draws[:, 0]
    bearings = np.deg2rad(sensor.field_of_view_deg) * (draws[:, 1] - 0.5)
    points = ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return _measured(points, np.zeros((len(draws), SENSORS[sensor.kind].dim)), sensor)
