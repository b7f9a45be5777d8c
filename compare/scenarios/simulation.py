"""Simulation of a scenario: the true path, the odometry and the observations of one seed."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.schema import Association, Assumed, Delayed, Fis, InverseDepth, Sensor, Trajectory
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.truth import Truth


def simulate(scenario: Scenario, seed: int) -> tuple[Truth, Recording]:
    """One run: its truth, and the recording that estimators see.

    The truth follows the commanded increments (v dt, 0, omega dt) exactly; the odometry is the command
    with noise on v and omega. Start, motion and sensor draw from streams of their own, so a change of
    the map leaves the odometry as it was.

    Raises:
        UserError: If the seed is negative.
    """
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    start_stream, motion_stream, sensor_stream = np.random.SeedSequence(seed).spawn(3)

    command = _commanded_increments(scenario.trajectory)
    poses = chain(_start(scenario, start_stream), command)
    landmarks = np.array(scenario.landmarks.positions, dtype=np.float64).reshape(-1, 2)
    seen_at, seen, observation = _observe(poses, landmarks, scenario.sensor, sensor_stream)

    dt = scenario.trajectory.step
    sigma_increment = dt * np.array([scenario.motion.sigma_speed, 0.0, np.deg2rad(scenario.motion.sigma_yaw_rate_deg)])
    motion_noise = sigma_increment * np.random.default_rng(motion_stream).standard_normal(command.shape)
    assumed = scenario.assumed
    odometry_cov = assumed.scale * assumed.motion_scale * np.diag(sigma_increment**2)
    observation_cov = assumed.scale * assumed.sensor_scale * np.diag(scenario.sensor.sigmas**2)

    truth = Truth(poses=poses, landmark_ids=np.arange(len(landmarks)), landmarks=landmarks, association=seen)
    recording = Recording(
        stamps=np.arange(len(poses), dtype=np.float64) * dt,
        prior_mean=np.array(scenario.prior.mean),
        prior_cov=np.diag(scenario.prior.variances),
        odometry=command + motion_noise,
        odometry_cov=np.broadcast_to(odometry_cov, (len(command), 3, 3)),
        sensor=scenario.sensor.kind,
        observation_step=seen_at,
        observation=observation,
        observation_cov=np.broadcast_to(observation_cov, (len(seen), *observation_cov.shape)),
        landmark=seen if scenario.association.method == "known" else None,
    )
    return truth, recording


def informed(scenario: Scenario) -> Scenario:
    """The scenario in which nobody is misled: the same measurements, their true noise, every association known.

    It is equal for scenarios that simulate the same, whatever estimators are told of it.
    """
    default = {"assumed": Assumed(), "association": Association(), "initialisation": "fis"}
    default |= {"fis": Fis(), "inverse_depth": InverseDepth(), "delayed": Delayed()}
    return scenario.model_copy(update={"name": "optimum", "description": "", **default})


def _start(scenario: Scenario, stream: np.random.SeedSequence) -> Float:
    """True start pose (3,): the prior's mean, or drawn from the prior."""
    mean = np.array(scenario.prior.mean)
    if scenario.start == "mean":
        return mean
    return mean + np.sqrt(scenario.prior.variances) * np.random.default_rng(stream).standard_normal(3)


def _commanded_increments(trajectory: Trajectory) -> Float:
    """Body-frame increments (N, 3) of the commanded path."""
    rates = [(segment.speed, 0.0, segment.yaw_rate) for segment in trajectory.segments]
    return np.repeat(np.array(rates) * trajectory.step, trajectory.steps, axis=0)


def _observe(poses: Float, landmarks: Float, sensor: Sensor, stream: np.random.SeedSequence) -> tuple[Int, Int, Float]:
    """Steps (M,), landmark ids (M,) and noisy values (M, d) of all that the sensor sees, in that order."""
    offsets = landmarks - poses[:, None, :2]
    body = np.einsum("nji,nlj->nli", rotation(poses[:, 2]), offsets)
    distance = np.linalg.norm(body, axis=2)
    in_view = (sensor.min_range <= distance) & (distance <= sensor.max_range)
    in_view[: sensor.first_step] = False
    seen_at, seen = np.nonzero(in_view)

    # a stream per landmark, drawn for every step: a landmark added to the map leaves the others' noise as it was
    sigmas = sensor.sigmas
    noise = np.empty((len(poses), len(landmarks), len(sigmas)))
    for landmark, child in enumerate(stream.spawn(len(landmarks))):
        noise[:, landmark] = sigmas * np.random.default_rng(child).standard_normal((len(poses), len(sigmas)))

    noise, body = noise[seen_at, seen], body[seen_at, seen]
    if sensor.kind == "position":
        return seen_at, seen, body + noise
    bearings = np.arctan2(body[:, 1], body[:, 0]) + noise[:, -1]
    if sensor.kind == "bearing":
        return seen_at, seen, wrap(bearings)[:, None]
    ranges = distance[seen_at, seen] + noise[:, 0]
    # no sensor reports a negative range: noise that reaches past zero is reflected
    return seen_at, seen, np.column_stack([np.abs(ranges), wrap(bearings)])
