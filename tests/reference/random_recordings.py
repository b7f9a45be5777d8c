"""Small random recordings for tests: full covariances, any sensor, singular motion noise on request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between, chain, rotation, wrap
from slamgauge.truth import Truth


def random_covariances(rng: np.random.Generator, count: int, sigmas: Float) -> Float:
    """Return correlated covariances (count, d, d) with standard deviations near `sigmas`."""
    dim = len(sigmas)
    A = np.eye(dim) + 0.3 * rng.normal(size=(count, dim, dim))
    A = A * np.asarray(sigmas)[:, None]
    return A @ A.swapaxes(1, 2)


def noisy_bearings(pose: Float, landmarks: Float, ids: Int, rng: np.random.Generator, sigma: float) -> Observations:
    """Return one bearing of each of the landmarks (n, 2)."""
    offset = landmarks - pose[:2]
    bearings = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - pose[2] + sigma * rng.normal(size=len(landmarks)))
    return Observations(ids, bearings[:, None], np.full((len(ids), 1, 1), sigma**2))


def bearing_only(recording: Recording) -> Recording:
    """Return a range-bearing recording without its ranges."""
    values, covs = recording.observation[:, 1:], recording.observation_cov[:, 1:, 1:]
    return replace(recording, sensor="bearing", observation=values, observation_cov=covs)


def recording_of(
    sensor: str, seed: int = 3, *, slip: bool = True, noise: float = 1.0, steps: int = 40, landmarks: int = 6
) -> Recording:
    """Return a random recording of any sensor; bearing-only recordings are range-bearing ones without ranges."""
    kind = "range-bearing" if sensor == "bearing" else sensor
    recording = random_recording(seed, sensor=kind, slip=slip, noise=noise, steps=steps, landmarks=landmarks)[1]
    return bearing_only(recording) if sensor == "bearing" else recording


def random_recording(
    seed: int,
    *,
    sensor: str = "range-bearing",
    steps: int = 40,
    landmarks: int = 6,
    slip: bool = True,
    noise: float = 1.0,
    prior_sigmas: tuple[float, float, float] = (0.1, 0.1, 0.02),
) -> tuple[Truth, Recording]:
    """Simulate a winding path among random landmarks, each observed with probability 1/2 at every step.

    Args:
        slip: with False the lateral motion noise is exactly zero.
        noise: scale of every standard deviation.
    """
    rng = np.random.default_rng(seed)
    commands = np.column_stack([np.full(steps, 0.5), np.zeros(steps), rng.normal(0.05, 0.2, steps)])
    if slip:
        motion_cov = random_covariances(rng, steps, noise * np.array([0.03, 0.02, 0.01]))
    else:
        motion_cov = np.tile(np.diag([0.03, 0.0, 0.01]) ** 2 * noise**2, (steps, 1, 1))
    prior_cov = np.diag(prior_sigmas) ** 2 * noise**2
    start = np.array([0.3, -0.2, 0.4])
    poses = chain(rng.multivariate_normal(start, prior_cov), commands)
    positions = poses[rng.integers(0, steps, landmarks), :2] + rng.choice([-1, 1], (landmarks, 2)) * rng.uniform(
        1.5, 4.0, (landmarks, 2)
    )
    step, landmark = np.nonzero(rng.random((steps + 1, landmarks)) < 0.5)
    delta = np.einsum("nji,nj->ni", rotation(poses[step, 2]), positions[landmark] - poses[step, :2])
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
    exact = delta if sensor == "position" else polar
    sigmas = noise * np.array([0.1, 0.1] if sensor == "position" else [0.1, 0.05])
    observation_cov = random_covariances(rng, len(step), sigmas)
    observation = exact + np.einsum("nij,nj->ni", np.linalg.cholesky(observation_cov), rng.normal(size=exact.shape))
    if sensor == "range-bearing":
        observation[:, 1] = wrap(observation[:, 1])
    root = np.linalg.cholesky(motion_cov + 1e-300 * np.eye(3))
    odometry = commands + np.einsum("nij,nj->ni", root, rng.normal(size=(steps, 3)))
    recording = Recording(
        stamps=np.linspace(0.0, 0.1 * steps, steps + 1),
        prior_mean=start,
        prior_cov=prior_cov,
        odometry=odometry,
        odometry_cov=motion_cov,
        sensor=sensor,  # pyrefly: ignore[bad-argument-type]
        observation_step=step,
        observation=observation,
        observation_cov=observation_cov,
        landmark=landmark * 3 + 2,
    )
    truth = Truth(
        poses=poses, landmark_ids=np.arange(landmarks) * 3 + 2, landmarks=positions, association=landmark * 3 + 2
    )
    assert np.allclose(between(poses[:-1], poses[1:])[:, :2], commands[:, :2])
    return truth, recording
