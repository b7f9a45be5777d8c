"""Laws of the prediction: paths without sights, against the recursion P <- F P F' + G Q G'."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.law import Law, Subject
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    World,
    any_start,
    correlated,
    pose_error,
    relative_error,
)

NO_LANDMARKS = np.zeros((0, 2))
FORWARD, TURN = 1e-2, 2e-3  # sigmas of a move [m], [rad]


def _path(rng: np.random.Generator, prior_cov: Float, steps: int, sigmas: tuple[float, float]) -> World:
    """A bent path of `steps` moves, with nothing to see."""
    moves = np.column_stack([rng.uniform(1.0, 2.0, steps), rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.6, steps)])
    return World(
        start=any_start(rng),
        prior_cov=prior_cov,
        moves=moves,
        move_sigmas=np.tile(sigmas, (steps, 1)),
        landmarks=NO_LANDMARKS,
        sights=(),
    )


def _jacobian(subject: Subject, rng: np.random.Generator) -> float:
    """An uncertain start carried along exact odometry: P = F P0 F'."""
    world = _path(rng, correlated(np.array([5e-3, 5e-3, 2e-3]), rng), steps=3, sigmas=(0.0, 0.0))
    right = [world.prior_cov]
    for before, after in zip(world.poses[:-1], world.poses[1:], strict=True):
        dx, dy = after[:2] - before[:2]
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        right.append(F @ right[-1] @ F.T)
    return relative_error(subject(world.recording()).pose_covs, np.array(right))


def _noise_frame(subject: Subject, rng: np.random.Generator) -> float:
    """One noisy move straight ahead from a known start: the position is uncertain along the heading."""
    world = _path(rng, KNOWN_START, steps=1, sigmas=(FORWARD, TURN))
    world = replace(world, moves=world.moves * [1.0, 0.0])
    axis = np.linalg.eigh(subject(world.recording()).pose_covs[-1, :2, :2])[1][:, -1]
    along, across = np.cos(world.start[2]), np.sin(world.start[2])
    return float(np.arcsin(min(1.0, abs(axis[1] * along - axis[0] * across))))


def _noise_size(subject: Subject, rng: np.random.Generator) -> float:
    """One noisy move from a known start: how far the position's largest sigma and the heading's are off."""
    world = _path(rng, KNOWN_START, steps=1, sigmas=(FORWARD, TURN))
    cov = subject(world.recording()).pose_covs[-1]
    variances = np.array([np.linalg.eigvalsh(cov[:2, :2])[-1], cov[2, 2]])
    return float(np.abs(np.sqrt(variances) / [FORWARD, TURN] - 1.0).max())


def _time_step(subject: Subject, rng: np.random.Generator) -> float:
    """The same increments and covariances a second and a tenth of it apart: time itself changes nothing."""
    world = _path(rng, KNOWN_START, steps=3, sigmas=(FORWARD, TURN))
    slow, fast = (subject(replace(world, step_s=step_s).recording()) for step_s in (1.0, 0.1))
    return max(pose_error(fast.poses, slow.poses), relative_error(fast.pose_covs[1:], slow.pose_covs[1:]))


PREDICTION = (
    Law(
        name="prediction-jacobian",
        figure="covariance of dead reckoning with exact odometry, largest difference to F P F' in sigmas squared",
        bound=1e-3,
        reason="exact for every filter of first order; sigmas of 2e-3 rad bend by 1e-5",
        blame="the Jacobian F of the prediction: its column of the heading is (-dy, dx), the move in the world frame",
        judge=_jacobian,
    ),
    Law(
        name="odometry-noise-frame",
        figure="angle between the position's error ellipse after a move straight ahead and that move [rad]",
        bound=1e-3,
        reason="exact for every filter of first order; sigmas of 2e-3 rad bend by 1e-5",
        blame="the frame of Q: odometry noise is in the body frame, turned into the world by the heading",
        judge=_noise_frame,
    ),
    Law(
        name="odometry-noise-size",
        figure="sigmas after one move from a known start, largest relative difference to those of the odometry",
        bound=1e-3,
        reason="exact for every filter of first order; sigmas of 2e-3 rad bend by 1e-5",
        blame="the size of Q: odometry_cov holds variances of the whole increment, in m^2 and rad^2",
        judge=_noise_size,
    ),
    Law(
        name="time-step",
        figure="the same increments 1 s and 0.1 s apart, largest difference of poses [m, rad] and of covariances [-]",
        bound=1e-6,
        reason="the same numbers in both; only rounding may differ",
        blame="the time step, once too often in Q or the motion: increments and odometry_cov are of whole steps",
        judge=_time_step,
    ),
)
