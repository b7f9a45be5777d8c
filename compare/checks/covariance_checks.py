"""Checks of covariances: prediction, prior, valid covariances, and the information that a robot at rest can gain.

Paths without observations are compared with the recursion P <- F P F' + G Q G'.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Subject, check, landmark_cov_of, pose_covs_of
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    SIGMA,
    World,
    any_start,
    around,
    at_rest,
    correlated,
    pose_error,
    relative_error,
)
from slamgauge.se2 import rotation

SIGMAS = (1e-2, 2e-3)  # forward motion [m] and turn [rad] of a move
RESTS = 100  # observations that make the sigma of a landmark small, whatever it was at first
ALTERNATING = tuple((step, (step - 1) % 2) for step in range(1, 7))


def _path(rng: np.random.Generator, prior_cov: Float, steps: int, sigmas: tuple[float, float] = SIGMAS) -> World:
    """Return a curved path of `steps` moves without landmarks."""
    moves = np.column_stack([rng.uniform(1.0, 2.0, steps), rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.6, steps)])
    return World(
        start=any_start(rng),
        prior_cov=prior_cov,
        moves=moves,
        move_sigmas=np.tile(sigmas, (steps, 1)),
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


@check(
    figure="no motion and no observation: largest difference of the start from the prior [m, rad, sigma^2]",
    bound=1e-6,
    blame="the initial state of the filter: start with prior_mean and prior_cov",
)
def prior_respected(subject: Subject, rng: np.random.Generator) -> float:
    """Run a recording of the start alone; a filter with its own initial covariance needs the right mean only."""
    world = at_rest(any_start(rng), correlated(np.array([0.3, 0.2, 0.1]), rng), np.ones((1, 2)), ((1, 0),))
    estimate = subject(world.recording().first(0))
    worst = pose_error(estimate.poses, world.poses[:1])
    if estimate.pose_covs is not None and not subject.ignores("prior"):
        worst = max(worst, relative_error(estimate.pose_covs[0], world.prior_cov))
    return worst


@check(
    figure="exactly known start, contradictory observations: motion [sigma of R] and variance [R] of the robot",
    bound=1e-3,
    blame="the inverse of a covariance that may be zero: invert S = H P H' + R, never P",
    needs=("odometry noise", "prior"),
    after=("prior-respected", "measurement-noise"),
)
def zero_prior(subject: Subject, rng: np.random.Generator) -> float:
    """Observe a landmark twice, with a difference of three sigmas; only the landmark may move."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    world = at_rest(start, np.zeros((3, 3)), landmarks, ((0, 0), (1, 0)))
    estimate = subject(world.recording(3.0 * SIGMA * np.array([[0.0, 0.0], [1.0, -1.0]])))
    worst = pose_error(estimate.poses, world.poses) / SIGMA
    if estimate.pose_covs is not None:
        worst = max(worst, float(np.abs(estimate.pose_covs).max()) / SIGMA**2)
    return worst


@check(
    figure="observations far more precise than odometry: relative difference of a sigma from its exact value",
    bound=0.05,
    blame="P after the update: P = P - K S K', in double precision, then P = (P + P')/2 or Joseph's form",
    needs=("odometry noise", "observation noise", "prior"),
    after=("measurement-noise",),
)
def sound_covariances(subject: Subject, rng: np.random.Generator) -> float:
    """Walk with imprecise odometry and precise observations, then correct a lost heading.

    An `Estimate` refuses covariances that are not symmetric positive semi-definite, but cannot detect lost variance. In
    a second run the robot observes a landmark RESTS times from the known start, so that the landmark's first covariance
    does not matter. Then the heading is lost four times, and one bearing corrects it each time. Its variance is that of
    this bearing plus that of the landmark, R (1 + 1 / RESTS).
    """
    start, steps = any_start(rng), 30
    walk = World(
        start=start,
        moves=np.tile([0.1, 0.0], (steps, 1)),
        move_sigmas=np.tile([1000.0 * SIGMA, 10.0 * SIGMA], (steps, 1)),
        landmarks=around(start, rng.uniform(8.0, 9.0, 2), np.array([0.2, -0.3])),
        observed=tuple((step, step % 2) for step in range(steps + 1)),
    )
    pose_covs_of(subject(walk.recording()))
    # a landmark 1 m ahead, as in `_wrong_direction` of `update_checks`
    start = np.append(rng.uniform(-3.0, 3.0, 2), 0.0)
    lost = World(
        start=start,
        moves=np.zeros((RESTS + 4, 2)),
        move_sigmas=np.column_stack([np.zeros(RESTS + 4), np.append(np.zeros(RESTS), rng.uniform(0.5, 1.0, 4))]),
        landmarks=around(start, np.ones(1), np.zeros(1)),
        observed=tuple((step, 0) for step in range(1, RESTS + 5)),
    )
    estimate = subject(lost.recording())
    relative = np.sqrt(pose_covs_of(estimate)[RESTS + 1 :, 2, 2] / (1.0 + 1.0 / RESTS)) / SIGMA
    if estimate.landmark_covs is not None and len(estimate.landmark_covs):
        relative = np.append(relative, np.sqrt(landmark_cov_of(estimate, 0)[0, 0] * len(lost.observed)) / SIGMA)
    return float(np.abs(relative - 1.0).max())


@check(
    figure="robot at rest, little noise: change of its pose [sigma] and of its covariance [sigma^2]",
    bound=0.02,
    blame="the dependence of a landmark on the pose of its first observation: cross-covariance, J_r, or columns of H "
    "that do not fit together",
    needs=("odometry noise", "prior"),
    after=("first-sight", "cross-covariance"),
)
def standing_robot(subject: Subject, rng: np.random.Generator) -> float:
    """Observe two landmarks three times each; neither the pose nor its covariance may change."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 2), np.array([0.6, -0.6]) + rng.uniform(-0.3, 0.3, 2))
    world = at_rest(start, correlated(SIGMA * np.array([20.0, 20.0, 10.0]), rng), landmarks, ALTERNATING)
    estimate = subject(world.noisy(rng))
    worst = float(np.abs((estimate.poses[-1] - start) / np.sqrt(np.diag(world.prior_cov))).max())
    if estimate.pose_covs is not None:
        worst = max(worst, relative_error(estimate.pose_covs[-1], world.prior_cov))
    return worst


@check(
    figure="robot at rest, much noise: relative decrease of the heading's sigma",
    bound=0.01,
    blame="Jacobians of one landmark at different estimates: together they give false information about the heading",
    excused_to=1.0,
    limit="the textbook EKF gains false information about the heading, because its Jacobians change with the estimate "
    "(Julier and Uhlmann 2001); fej-ekf, oc-ekf and riekf do not",
    needs=("odometry noise", "observation noise", "prior"),
    after=("standing-robot",),
)
def standing_robot_in_noise(subject: Subject, rng: np.random.Generator) -> float:
    """Observe two landmarks sixty times each; they give no information about the pose."""
    sigma, heading = 0.05, 0.3
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 2), np.array([1.2, -1.2]) + rng.uniform(-0.3, 0.3, 2))
    observed = tuple((step, (step - 1) % 2) for step in range(1, 121))
    world = at_rest(start, np.diag([0.01, 0.01, heading**2]), landmarks, observed)
    recording = world.noisy(rng, sigma, sigma)
    return float(1.0 - np.sqrt(pose_covs_of(subject(recording))[-1, 2, 2]) / heading)


PREDICTION_CHECKS = (prediction_jacobian, odometry_noise_frame, odometry_noise_size, time_step)
CHECKS = (prior_respected, zero_prior, sound_covariances, standing_robot, standing_robot_in_noise)
