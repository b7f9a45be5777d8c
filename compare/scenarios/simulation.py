"""Simulation of a scenario: the true path, the odometry and the observations of one seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, freeze
from slamgauge.compare.scenarios.observation_simulation import observe
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario
from slamgauge.compare.scenarios.schema import Association, Assumed, Delayed, Fis, Update
from slamgauge.covariances import square_roots
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.truth import NOBODY, Truth


def simulate(scenario: Scenario | str | Path, seed: int) -> tuple[Truth, Recording]:
    """Simulate one run: its truth, and the recording for estimators.

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
    seen = observe(poses, landmarks, sensor, (noise, *others))
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
