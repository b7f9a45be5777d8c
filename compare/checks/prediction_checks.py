"""Checks of the prediction: paths without observations, compared with the recursion P <- F P F' + G Q G'."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Subject, check, pose_covs_of
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    World,
    any_start,
    correlated,
    pose_error,
    relative_error,
)
from slamgauge.se2 import rotation

SIGMAS = (1e-2, 2e-3)  # forward motion [m] and turn [rad] of a move


def _path(rng: np.random.Generator, prior_cov: Float, steps: int, sigmas: tuple[float, float] = SIGMAS) -> World:
    """Return a curved path of `steps` moves without landmarks."""
    moves = np.column_stack([rng.uniform(1.0, 2.0, steps), rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.6, steps)])
    return World(
        start=any_start(rng),
        prior_cov=prior_cov,
        moves=moves,
        move_sigmas=np.tile(sigmas, (steps, 1)),
        landmarks=np.zeros((0, 2)),
        observed=(),
    )


@check(
    figure="increase of the covariance of dead reckoning by a larger prior: difference from F P F' [sigma^2]",
    bound=1e-3,
    blame="the Jacobian F of the prediction: its heading column is (-dy, dx), with the displacement in the world frame",
    needs=("prior",),
    after=("truth-recovered", "prior-respected"),
)
def prediction_jacobian(subject: Subject, rng: np.random.Generator) -> float:
    """Propagate two uncertain starts: the difference of their covariances is F P0 F', whatever Q is.

    F follows from the displacements of the estimate, also for a filter that moves on arcs.
    """
    world = _path(rng, correlated(np.array([5e-3, 5e-3, 2e-3]), rng), steps=3, sigmas=(0.0, 0.0))
    once, twice = (subject(replace(world, prior_cov=times * world.prior_cov).recording()) for times in (1.0, 2.0))
    right = [world.prior_cov]
    for before, after in pairwise(once.poses):
        dx, dy = after[:2] - before[:2]
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        right.append(F @ right[-1] @ F.T)
    return relative_error(pose_covs_of(twice) - pose_covs_of(once), np.array(right))


@check(
    figure="angle between the position's error ellipse after a straight move and that move [rad]; for own noise: "
    "difference of the ellipses after two moves in different directions, as seen from the robot [sigma^2]",
    bound=1e-3,
    blame="the frame of Q: odometry noise is in the body frame and must be rotated to the world frame by the heading",
    needs=("prior",),
    after=("prediction-jacobian", "odometry-noise-size"),
)
def odometry_noise_frame(subject: Subject, rng: np.random.Generator) -> float:
    """Make one noisy straight move from a known start: the position is uncertain along the heading."""
    world = _path(rng, KNOWN_START, steps=1)
    world = replace(world, moves=world.moves * [1.0, 0.0])
    ellipse = pose_covs_of(subject(world.recording()))[-1, :2, :2]
    if subject.has_own_noise:
        turn = np.array([0.0, 0.0, rng.uniform(0.5, 1.0)])
        other = pose_covs_of(subject(replace(world, start=world.start + turn).recording()))[-1, :2, :2]
        back = rotation(-turn[2])
        return relative_error(back @ other @ back.T, ellipse)
    axis = np.linalg.eigh(ellipse)[1][:, -1]
    along, across = np.cos(world.start[2]), np.sin(world.start[2])
    return float(np.arcsin(min(1.0, abs(axis[1] * along - axis[0] * across))))


@check(
    figure="sigmas after one move from a known start: largest relative difference from those of the odometry",
    bound=1e-3,
    blame="the size of Q: odometry_cov contains variances of the whole increment, in m^2 and rad^2",
    needs=("odometry noise", "prior"),
)
def odometry_noise_size(subject: Subject, rng: np.random.Generator) -> float:
    """Make one noisy straight move from a known start; compare the sigmas along it and of the heading."""
    world = _path(rng, KNOWN_START, steps=1)
    cov = pose_covs_of(subject(replace(world, moves=world.moves * [1.0, 0.0]).recording()))[-1]
    variances = np.array([np.linalg.eigvalsh(cov[:2, :2])[-1], cov[2, 2]])
    return float(np.abs(np.sqrt(variances) / SIGMAS - 1.0).max())


@check(
    figure="the same increments 1 s and 0.1 s apart: largest difference of poses [m, rad] and covariances [sigma^2]",
    bound=1e-6,
    blame="a factor of the time step too many or too few in Q, F, or the motion: increments and odometry_cov are of "
    "whole steps",
    needs=("odometry noise",),
    after=("odometry-noise-size",),
)
def time_step(subject: Subject, rng: np.random.Generator) -> float:
    """Compare two recordings that differ only in their time steps."""
    world = _path(rng, KNOWN_START, steps=3)
    slow, fast = (subject(replace(world, step_s=step_s).recording()) for step_s in (1.0, 0.1))
    return max(pose_error(fast.poses, slow.poses), relative_error(pose_covs_of(fast)[1:], pose_covs_of(slow)[1:]))


CHECKS = (prediction_jacobian, odometry_noise_frame, odometry_noise_size, time_step)
