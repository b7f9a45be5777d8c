"""Simulation of a scenario: the true path, the odometry and the observations of one seed."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, freeze
from slamgauge.compare.scenarios.measurement_errors import covs
from slamgauge.compare.scenarios.observation_simulation import Observed, Streams, observe
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
    scenario = as_scenario(scenario)
    measured = _measure(scenario, seed)
    return measured.truth, measured.recording(scenario)


def simulate_informed(scenario: Scenario, seed: int) -> tuple[Truth, Recording, Recording]:
    """Simulate one run: truth, recording for estimators, and recording for the optima (see `informed`)."""
    measured = _measure(scenario, seed)
    return measured.truth, measured.recording(scenario), measured.recording(informed(scenario))


class _Measured(NamedTuple):
    """Truth and measurements of a run, with the covariances of the simulated noise."""

    truth: Truth
    stamps: Float
    odometry: Float
    odometry_cov: Float  # (N, 3, 3)
    seen: Observed

    def recording(self, scenario: Scenario) -> Recording:
        """Return the recording with the noise and the association that the scenario gives to estimators."""
        assumed, association = scenario.assumed, self.truth.association
        assert association is not None and self.truth.landmarks is not None
        known = scenario.association.method == "known"
        return Recording(
            stamps=self.stamps,
            prior_mean=np.array(scenario.prior.mean),
            prior_cov=scenario.prior.cov,
            odometry=self.odometry,
            odometry_cov=_scaled(self.odometry_cov, assumed.scale * assumed.motion_scale),
            sensor=scenario.sensor.kind,
            observation_step=self.seen.step,
            observation=self.seen.value,
            observation_cov=_scaled(self.seen.cov, assumed.scale * assumed.sensor_scale),
            landmark=_ids(association, len(self.truth.landmarks)) if known else None,
        )


def _measure(scenario: Scenario, seed: int) -> _Measured:
    if not isinstance(seed, int | np.integer):
        raise UserError(f"seed: {seed!r} is not valid; use a whole number >= 0")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    start_stream, motion_stream, noise, slip, *others = np.random.SeedSequence(seed).spawn(9)
    trajectory, motion = scenario.trajectory, scenario.motion

    command = trajectory.increments(scenario.prior.mean)
    poses = chain(_start(scenario, start_stream), command)
    landmarks = scenario.landmarks.all()
    seen = observe(poses, landmarks, scenario.sensor, Streams(noise, *others))
    draws = np.random.default_rng(slip).random((2, len(command)))
    motion_noise, odometry_cov = _motion_noise(scenario, np.random.default_rng(motion_stream))
    odometry, stamps = motion.misread(command, *draws) + motion_noise, trajectory.stamps(scenario.prior.mean)
    freeze(poses, odometry, seen.step, seen.landmark, seen.value)  # records share them
    truth = Truth(
        poses=poses,
        landmark_ids=np.arange(len(landmarks)),
        landmarks=landmarks,
        association=seen.landmark,
        outlier=seen.outlier if scenario.sensor.outlier_rate > 0.0 else None,
    )
    return _Measured(truth, stamps, odometry, np.broadcast_to(odometry_cov, (len(command), 3, 3)), seen)


def _scaled(covs: Float, factor: float) -> Float:
    """Return covariances (n, d, d) times a factor; a broadcast one is multiplied once."""
    if len(covs) and covs.strides[0] == 0:
        return np.broadcast_to(factor * covs[0], covs.shape)
    return factor * covs


def _motion_noise(scenario: Scenario, generator: np.random.Generator) -> tuple[Float, Float]:
    """Return the noise (N, 3) of the increments [m, m, rad], and its covariances (N, 3, 3) or (3, 3)."""
    trajectory, table = scenario.trajectory, scenario.motion.covariances
    if table is not None:
        cov = covs(table)
        return np.einsum("nij,nj->ni", square_roots(cov), generator.standard_normal((len(cov), 3))), cov
    sigmas = scenario.motion.sigmas(trajectory.durations())
    steps = len(trajectory.stamps(scenario.prior.mean)) - 1
    return sigmas * generator.standard_normal((steps, 3)), sigmas[..., None] ** 2 * np.eye(3)


def _ids(landmark: Int, landmarks: int) -> Int:
    """Return the ids (M,) of a recording: each clutter observation has a new id."""
    clutter = landmark == NOBODY
    return np.where(clutter, landmarks - 1 + np.cumsum(clutter), landmark) if clutter.any() else landmark


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
