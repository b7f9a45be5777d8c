"""Simulation of a scenario: the true path, the odometry and the observations of one seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.scenarios.motion import covs
from slamgauge.compare.scenarios.observing import Streams, observe
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario
from slamgauge.compare.scenarios.schema import Association, Assumed, Delayed, Fis, InverseDepth, Update
from slamgauge.correlations import square_roots
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.truth import NOBODY, Truth


def simulate(scenario: Scenario | str | Path, seed: int) -> tuple[Truth, Recording]:
    """One run: its truth, and the recording that estimators see.

    The truth follows the commanded increments exactly; the odometry is the command as the motion misreads it, with
    noise. Every kind of draw has a stream of its own: a change of the map leaves the odometry as it was, and so does
    every option all other draws.

    Args:
        scenario: itself, or the name or path of one.
        seed: of all noise.

    Raises:
        UserError: If the seed is negative.
    """
    scenario = as_scenario(scenario)
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    start_stream, motion_stream, noise, slip, *others = np.random.SeedSequence(seed).spawn(9)
    trajectory, motion, assumed = scenario.trajectory, scenario.motion, scenario.assumed

    command = trajectory.increments(scenario.prior.mean)
    poses = chain(_start(scenario, start_stream), command)
    landmarks = scenario.landmarks.all()
    seen = observe(poses, landmarks, scenario.sensor, Streams(noise, *others))
    draws = np.random.default_rng(slip).random((2, len(command)))
    motion_noise, odometry_cov = _motion_noise(scenario, np.random.default_rng(motion_stream))

    sensor = scenario.sensor
    truth = Truth(
        poses=poses,
        landmark_ids=np.arange(len(landmarks)),
        landmarks=landmarks,
        association=seen.landmark,
        outlier=seen.outlier if sensor.outlier_rate > 0.0 else None,
    )
    recording = Recording(
        stamps=trajectory.stamps(scenario.prior.mean),
        prior_mean=np.array(scenario.prior.mean),
        prior_cov=scenario.prior.cov,
        odometry=motion.misread(command, *draws) + motion_noise,
        odometry_cov=np.broadcast_to(assumed.scale * assumed.motion_scale * odometry_cov, (len(command), 3, 3)),
        sensor=sensor.kind,
        observation_step=seen.step,
        observation=seen.value,
        observation_cov=assumed.scale * assumed.sensor_scale * seen.cov,
        landmark=_ids(seen.landmark, len(landmarks)) if scenario.association.method == "known" else None,
    )
    return truth, recording


def _motion_noise(scenario: Scenario, generator: np.random.Generator) -> tuple[Float, Float]:
    """Noise (N, 3) of the increments [m, m, rad], and its covariances (N, 3, 3) or (3, 3)."""
    trajectory, table = scenario.trajectory, scenario.motion.covariances
    if table is not None:
        cov = covs(table)
        return np.einsum("nij,nj->ni", square_roots(cov), generator.standard_normal((len(cov), 3))), cov
    sigmas = scenario.motion.sigmas(trajectory.durations())
    steps = len(trajectory.stamps(scenario.prior.mean)) - 1
    return sigmas * generator.standard_normal((steps, 3)), sigmas[..., None] ** 2 * np.eye(3)


def _ids(landmark: Int, landmarks: int) -> Int:
    """Ids (M,) that the recording gives: clutter has those that no landmark has, each its own."""
    return np.where(landmark == NOBODY, landmarks - 1 + np.cumsum(landmark == NOBODY), landmark)


def informed(scenario: Scenario) -> Scenario:
    """The scenario in which nobody is misled: the same measurements, their true noise, every association known.

    It is equal for scenarios that simulate the same, whatever estimators are told of it.
    """
    default = {"assumed": Assumed(), "association": Association(), "update": Update(), "initialisation": "fis"}
    default |= {"fis": Fis(), "inverse_depth": InverseDepth(), "delayed": Delayed()}
    return scenario.model_copy(update={"name": "optimum", "description": "", **default})


def _start(scenario: Scenario, stream: np.random.SeedSequence) -> Float:
    """True start pose (3,): the prior's mean, or drawn from the prior."""
    mean, prior = np.array(scenario.prior.mean), scenario.prior
    if scenario.start == "mean":
        return mean
    drawn = np.random.default_rng(stream).standard_normal(3)
    if prior.covariance is not None:
        return mean + square_roots(prior.cov[None])[0] @ drawn
    return mean + np.sqrt(prior.variances) * drawn
