"""Checks of a new landmark and of one correction, compared with closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Subject, check, landmark_cov_of, landmark_of, pose_covs_of
from slamgauge.compare.checks.small_recordings import (
    KNOWN,
    KNOWN_START,
    SIGMA,
    World,
    any_start,
    around,
    at_rest,
    correlated,
    relative_error,
)

MOVES = 30  # with noise, between two observations
LOOSE = 50.0 * SIGMA  # sigma of a move; observations are exact in comparison


def _observation_jacobian(start: Float, landmark: Float) -> Float:
    """Return the Jacobian (2, 2) of a landmark's position by range and bearing from the pose `start`."""
    dx, dy = landmark - start[:2]
    return np.array([[dx, -dy], [dy, dx]]) / [np.hypot(dx, dy), 1.0]


@check(
    figure="covariance of a landmark observed once: largest difference from J_r P J_r' + J_z R J_z' [sigma^2]",
    bound=0.02,
    blame="the Jacobians of a new landmark: J_r by the pose, heading included, and J_z by the observation",
    needs=("prior",),
)
def first_sight(subject: Subject, rng: np.random.Generator) -> float:
    """Observe a landmark once from an uncertain pose.

    For a filter with its own noise, the difference of two covariances with two priors is J_r P J_r', whatever R is.
    """
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    world = at_rest(start, correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng), landmarks, ((1, 0),))
    dx, dy = landmarks[0] - start[:2]
    Jr, Jz = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]]), _observation_jacobian(start, landmarks[0])
    from_pose, from_observation = Jr @ world.prior_cov @ Jr.T, SIGMA**2 * Jz @ Jz.T
    found = landmark_cov_of(subject(world.recording()), 0)
    if not subject.ignores("odometry noise", "observation noise"):
        return relative_error(found, from_pose + from_observation)
    twice = replace(world, prior_cov=2.0 * world.prior_cov)
    return relative_error(landmark_cov_of(subject(twice.recording()), 0) - found, from_pose)


@check(
    figure="correction of the robot after it observed a new landmark: difference of their motions, relative",
    bound=0.05,
    blame="the cross-covariance of a new landmark with the rest of the state: P_new,: = J_r P_r,:",
)
def cross_covariance(subject: Subject, rng: np.random.Generator) -> float:
    """Correct the robot after it observed a new landmark from an uncertain pose; the landmark must move by the same.

    The robot observes landmark 0 from the known start, and landmark 1 after 30 noisy moves along x. Then a range to
    landmark 0 moves the robot. A filter with its own noise may add that of one more step to the robot: 1/31.
    """
    sigma = LOOSE
    landmarks = np.array([[rng.uniform(6.0, 9.0), 0.0], [rng.uniform(3.0, 5.0), rng.uniform(1.0, 3.0)]])
    moving = np.repeat([0.0, 1.0, 0.0], [1, MOVES, 1])[:, None]
    world = World(
        moves=moving * [1.0 / MOVES, 0.0],
        move_sigmas=moving * [sigma / np.sqrt(MOVES), 0.0],
        landmarks=landmarks,
        observed=((1, 0), (MOVES + 1, 1), (MOVES + 2, 0)),
    )
    shift = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * sigma
    recording = world.recording(np.array([[0.0, 0.0], [0.0, 0.0], [shift, 0.0]]))
    before, after = subject(recording.first(MOVES + 1)), subject(recording)
    robot = after.poses[-1, :2] - before.poses[-1, :2]
    landmark = landmark_of(after, 1) - landmark_of(before, 1)
    return float(np.linalg.norm(landmark - robot) / max(np.linalg.norm(robot), 1e-3 * abs(shift)))


def _imprecise_move(rng: np.random.Generator, forward_sigma: float, turn_sigma: float) -> World:
    """Return a world with a landmark ahead, observed from a known start and after a move with the given noise."""
    return World(
        moves=np.zeros((2, 2)),
        move_sigmas=np.array([[0.0, 0.0], [forward_sigma, turn_sigma]]),
        landmarks=np.array([[rng.uniform(3.0, 6.0), 0.0]]),
        observed=((1, 0), (2, 0)),
    )


def _error_of_landmark(subject: Subject, rng: np.random.Generator, channel: int) -> float:
    """Return the relative error of a landmark and its variance after two observations from a known pose.

    The second observation moves the landmark by half of their difference, and halves its variance.
    """
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    shift = np.zeros((2, 2))
    shift[1, channel] = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0) * SIGMA
    estimate = subject(at_rest(start, KNOWN_START, landmarks, ((1, 0), (2, 0))).recording(shift))
    if not len(estimate.landmark_ids):
        return 0.0
    H = np.linalg.inv(_observation_jacobian(start, landmarks[0]))
    moved = H @ (landmark_of(estimate, 0) - landmarks[0]) / shift[1, channel]
    worst = np.abs(moved - np.eye(2)[channel] / 2).max()
    if estimate.landmark_covs is not None:
        worst = max(worst, abs((H @ landmark_cov_of(estimate, 0) @ H.T)[channel, channel] / SIGMA**2 - 0.5))
    return float(worst)


@check(
    figure="update by one range: largest relative difference of landmark, its variance and robot from the exact one",
    bound=0.01,
    blame="the row of H for the range, the gain, or P after the update: dr = ((l - p)/r)'(dl - dp), P = P - K S K'",
    needs=("odometry noise", "observation noise", "prior"),
)
def update_range(subject: Subject, rng: np.random.Generator) -> float:
    """Correct a robot whose position along x is uncertain: it moves by the whole innovation."""
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    recording = _imprecise_move(rng, LOOSE, 0.0).recording(np.array([[0.0, 0.0], [shift, 0.0]]))
    robot = abs(subject(recording).poses[-1, 0] / shift + 1.0)
    return max(float(robot), _error_of_landmark(subject, rng, 0))


@check(
    figure="update by one bearing: largest relative difference of landmark, its variance and robot from the exact one",
    bound=0.01,
    blame="the row of H for a bearing, or the gain: (-dy, dx)/r^2 for a landmark, its opposite and -1 for the pose",
    needs=("odometry noise", "observation noise", "prior"),
)
def update_bearing(subject: Subject, rng: np.random.Generator) -> float:
    """Correct a robot whose heading is uncertain: it turns by the whole innovation."""
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    recording = _imprecise_move(rng, 0.0, LOOSE).recording(np.array([[0.0, 0.0], [0.0, shift]]))
    robot = abs(subject(recording).poses[-1, 2] / shift + 1.0)
    return max(float(robot), _error_of_landmark(subject, rng, 1))


@check(
    figure="heading sigma after a correction by one bearing: relative difference from sqrt(2 R)",
    bound=0.01,
    blame="R in the innovation covariance: S = H P H' + R, where observation_cov contains variances",
    needs=("odometry noise", "observation noise", "prior"),
)
def measurement_noise(subject: Subject, rng: np.random.Generator) -> float:
    """Correct an uncertain heading: its variance becomes that of the bearing plus that of the landmark, 2 R."""
    cov = pose_covs_of(subject(_imprecise_move(rng, 0.0, LOOSE).recording()))[-1]
    right = np.sqrt(1.0 / (1.0 / LOOSE**2 + 1.0 / (2.0 * SIGMA**2)))
    return float(abs(np.sqrt(cov[2, 2]) / right - 1.0))


@check(
    figure="landmark observed on both sides of the bearing pi: motion of landmark and robot [sigma]",
    bound=1.0,
    blame="the innovation of a bearing: wrap z - h(x) to (-pi, pi] before the gain",
)
def innovation_wrap(subject: Subject, rng: np.random.Generator) -> float:
    """Observe a landmark straight behind, just left and just right of the bearing pi."""
    start = np.append(rng.uniform(-3.0, 3.0, 2), 0.0)
    distance, side = rng.uniform(3.0, 6.0), rng.choice([-1.0, 1.0]) * 0.2 * SIGMA
    landmarks = around(start, np.array([distance]), np.array([np.pi]))
    world = at_rest(start, KNOWN_START, landmarks, ((1, 0), (2, 0)))
    before, after = (subject(world.recording(np.array([[0.0, side], [0.0, last]]))) for last in (side, -side))
    has_own_noise = subject.ignores("odometry noise", "observation noise", "prior")
    unit = 10.0 * distance * SIGMA if has_own_noise else KNOWN  # the start may be uncertain for its own noise
    moved = float(np.abs(after.poses[-1] - before.poses[-1]).max() / unit)
    if len(after.landmark_ids):
        moved = max(moved, float(np.linalg.norm(landmark_of(after, 0) - landmark_of(before, 0)) / (distance * SIGMA)))
    return moved


CHECKS = (first_sight, cross_covariance, update_range, update_bearing, measurement_noise, innovation_wrap)
