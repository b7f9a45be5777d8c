"""Checks of a new landmark and of one correction, compared with closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Subject, check, landmark_cov_of, landmark_of
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
from slamgauge.recording import Recording
from slamgauge.se2 import rotation

MOVES = 30  # with noise, between two observations
COARSE = 1.0  # sigma of ranges [m] or bearings [rad] that correct nothing, even by a wrong row of H
LOOSE = 50.0 * SIGMA  # sigma of a move; observations are exact in comparison
SHARE = 0.01  # largest relative difference of a motion; second order is less
SAME_CORRECTION = 0.02  # largest relative difference of two corrections


@check(
    figure="covariance of a landmark observed once: largest difference from J_r P J_r' + J_z R J_z' [sigma^2]",
    bound=0.02,
    blame="the Jacobians of a new landmark: J_r by the pose, heading included, and J_z by the observation; for a "
    "landmark that is in the state from the start, P after its first update",
    needs=("prior",),
    after=("prior-respected", "sound-covariances"),
)
def first_sight(subject: Subject, rng: np.random.Generator) -> float:
    """Observe a landmark once from an uncertain pose.

    For a filter with its own noise, the difference of two covariances with two priors is J_r P J_r', whatever R is.
    """
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    world = at_rest(start, correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng), landmarks, ((1, 0),))
    dx, dy = landmarks[0] - start[:2]
    Jr, Jz = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]]), np.array([[dx, -dy], [dy, dx]]) / [np.hypot(dx, dy), 1.0]
    from_pose, from_observation = Jr @ world.prior_cov @ Jr.T, SIGMA**2 * Jz @ Jz.T
    found = landmark_cov_of(subject(world.recording()), 0)
    if not subject.has_own_noise:
        return relative_error(found, from_pose + from_observation)
    twice = replace(world, prior_cov=2.0 * world.prior_cov)
    return relative_error(landmark_cov_of(subject(twice.recording()), 0) - found, from_pose)


@check(
    figure="correction of the robot after it observed a new landmark: difference of their motions, relative",
    bound=0.05,
    blame="the cross-covariance of a new landmark with the rest of the state, P_new,: = J_r P_r,:, or that of robot "
    "and landmarks after the prediction, P_r,: = F P_r,:",
    after=("first-sight", "prediction-jacobian"),
)
def cross_covariance(subject: Subject, rng: np.random.Generator) -> float:
    """Correct the robot after it observed a new landmark from an uncertain pose; the landmark must move by the same.

    The robot observes landmark 0 from the known start, and landmark 1 after 30 noisy moves along x. Then a range to
    landmark 0 moves the robot. A filter with its own noise may add that of one more step to the robot: 1/31.
    """
    landmarks = np.array([[rng.uniform(6.0, 9.0), 0.0], [rng.uniform(3.0, 5.0), rng.uniform(1.0, 3.0)]])
    moving = np.repeat([0.0, 1.0, 0.0], [1, MOVES, 1])[:, None]
    world = World(
        moves=moving * [1.0 / MOVES, 0.0],
        move_sigmas=moving * [LOOSE / np.sqrt(MOVES), 0.0],
        landmarks=landmarks,
        observed=((1, 0), (MOVES + 1, 1), (MOVES + 2, 0)),
    )
    shift = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * LOOSE
    recording = world.recording(np.array([[0.0, 0.0], [0.0, 0.0], [shift, 0.0]]))
    before, after = subject(recording.first(MOVES + 1)), subject(recording)
    robot = after.poses[-1, :2] - before.poses[-1, :2]
    landmark = landmark_of(after, 1) - landmark_of(before, 1)
    difference = float(np.linalg.norm(landmark - robot) / max(np.linalg.norm(robot), 1e-3 * abs(shift)))
    return difference if subject.ignores("odometry noise") else max(difference, _wrong_rotation(subject, rng))


def _wrong_rotation(subject: Subject, rng: np.random.Generator) -> float:
    """Correct the heading after a move; a landmark that was observed before the move must turn with it.

    The robot observes landmark 0 from the known start, and landmark 1 after a noisy turn on the spot. It moves half way
    to landmark 0, where a bearing to landmark 0 corrects both the heading and the position that follows from it.
    """
    landmarks = np.array([[8.0, 0.0], [rng.uniform(3.0, 5.0), rng.uniform(1.0, 3.0)]])
    world = World(
        moves=np.array([[0.0, 0.0], [0.0, 0.0], [4.0, 0.0]]),
        move_sigmas=np.array([[0.0, 0.0], [0.0, LOOSE], [0.0, 0.0]]),
        landmarks=landmarks,
        observed=((1, 0), (2, 1), (3, 0)),
    )
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    estimate = subject(world.recording(np.array([[0.0, 0.0], [0.0, 0.0], [0.0, shift]])))
    turn, moved = estimate.poses[-1, 2], landmark_of(estimate, 1) - landmarks[1]
    rotated = turn * np.array([-landmarks[1, 1], landmarks[1, 0]])
    return float(np.linalg.norm(moved - rotated) / max(np.linalg.norm(rotated), 1e-3 * abs(shift)))


def _imprecise_move(forward_sigma: float, turn_sigma: float, landmark: Float) -> World:
    """Return a world with a landmark (2,) [m], observed from a known start and after a move with the given noise."""
    return World(
        moves=np.zeros((2, 2)),
        move_sigmas=np.array([[0.0, 0.0], [forward_sigma, turn_sigma]]),
        landmarks=landmark[None],
        observed=((1, 0), (2, 0)),
    )


def _shifted(world: World, channel: int, shift: float) -> Recording:
    """Return a recording whose last range (channel 0) [m] or bearing (1) [rad] is larger by `shift`.

    The other value of the last observation is coarse.
    """
    disturbance, sigma = np.zeros((len(world.observed), 2)), np.full((len(world.observed), 2), SIGMA)
    disturbance[-1, channel], sigma[-1, 1 - channel] = shift, COARSE
    return world.recording(disturbance, sigma)


def _wrong_share(subject: Subject, recording: Recording, channel: int, variance: float, moved: float) -> float:
    """Return by how much a robot that moved by `moved` of the last innovation did not move by the right share of it.

    The share follows from the variance of the innovation due to the robot, and from the filter's own covariance of the
    landmark, which `first_sight` judges. A filter with its own noise may move by any share with the right sign.
    """
    if subject.has_own_noise:
        return 0.0 if 0.0 < moved <= 1.0 + SHARE else 1.0
    first = subject(recording.first(1))
    of_landmark = SIGMA**2
    if first.landmark_covs is not None and len(first.landmark_covs):
        dx, dy = landmark_of(first, 0) - first.poses[-1, :2]
        row = (np.array([dx, dy]) / np.hypot(dx, dy), np.array([-dy, dx]) / (dx**2 + dy**2))[channel]
        of_landmark = row @ landmark_cov_of(first, 0) @ row
    share = variance / (variance + of_landmark + SIGMA**2)
    return float(abs(moved - share) / share)


def _wrong_direction(subject: Subject, rng: np.random.Generator, channel: int) -> float:
    """Return the sine of the angle between the motion of a landmark at its second observation and the right motion.

    The robot is at rest, and the landmark is 1 m ahead along x, then along y. There J_z is diag(1, 1) or a quarter
    turn, so that its errors do not matter. An opposite motion, or none, gives 1.
    """
    shift = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0) * SIGMA
    worst = 0.0
    for heading in (0.0, np.pi / 2):
        start = np.append(rng.uniform(-3.0, 3.0, 2), heading)
        landmark = around(start, np.ones(1), np.zeros(1))
        world = at_rest(start, KNOWN_START, landmark, ((1, 0), (2, 0)))
        estimate = subject(_shifted(world, channel, shift))
        if not len(estimate.landmark_ids):
            return 0.0
        moved = rotation(heading).T @ (landmark_of(estimate, 0) - landmark[0]) / shift
        along, across = moved[channel], moved[1 - channel]
        worst = max(worst, abs(across) / np.hypot(along, across) if along > 0.0 else 1.0)
    return float(worst)


@check(
    figure="update by one range: relative difference of the robot's motion from the innovation, or sine of the angle "
    "between the landmark's motion and the line of sight",
    bound=SHARE,
    blame="the predicted range, its row of H, or the gain: dr = ((l - p)/r)'(dl - dp)",
    needs=("prior",),
    after=("landmarks-behind", "odometry-noise-size"),
)
def update_range(subject: Subject, rng: np.random.Generator) -> float:
    """Correct a robot whose position along x is uncertain: it moves by the whole innovation."""
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    recording = _shifted(_imprecise_move(LOOSE, 0.0, np.array([rng.uniform(3.0, 6.0), 0.0])), 0, shift)
    share = _wrong_share(subject, recording, 0, LOOSE**2, -subject(recording).poses[-1, 0] / shift)
    return max(share, _wrong_direction(subject, rng, 0))


@check(
    figure="update by one bearing: relative difference of the robot's motion from the innovation, or sine of the angle "
    "between the landmark's motion and the normal of the line of sight",
    bound=SHARE,
    blame="the predicted bearing, its row of H, or the gain: (-dy, dx)/r^2 for a landmark, its opposite and -1 for the "
    "pose",
    needs=("prior",),
    after=("landmarks-behind", "odometry-noise-size"),
)
def update_bearing(subject: Subject, rng: np.random.Generator) -> float:
    """Correct a robot whose heading is uncertain: it turns by the whole innovation.

    Then correct one whose position along x is uncertain, by a landmark abeam: it moves by the innovation times the
    range.
    """
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    distance = rng.uniform(3.0, 6.0)
    ahead, abeam = distance * np.eye(2)
    turning = _shifted(_imprecise_move(0.0, LOOSE, ahead), 1, shift)
    moving = _shifted(_imprecise_move(distance * LOOSE, 0.0, abeam), 1, shift)
    turned, moved = -subject(turning).poses[-1, 2] / shift, subject(moving).poses[-1, 0] / (distance * shift)
    shares = (_wrong_share(subject, *each) for each in ((turning, 1, LOOSE**2, turned), (moving, 1, LOOSE**2, moved)))
    return max(*shares, _wrong_direction(subject, rng, 1))


@check(
    figure="correction of a heading by one bearing, which is as uncertain as landmark and bearing: difference from 1/2",
    bound=0.01,
    blame="R in the innovation covariance, S = H P H' + R, or in that of a new landmark: observation_cov contains "
    "variances",
    needs=("observation noise", "odometry noise", "prior"),
    after=("update-range", "update-bearing"),
)
def measurement_noise(subject: Subject, rng: np.random.Generator) -> float:
    """Correct a heading with the variance 2 R: landmark and bearing have 2 R together, so that it turns by a half."""
    shift = rng.choice([-1.0, 1.0]) * SIGMA
    recording = _shifted(_imprecise_move(0.0, np.sqrt(2.0) * SIGMA, np.array([1.0, 0.0])), 1, shift)
    return _wrong_share(subject, recording, 1, 2.0 * SIGMA**2, -subject(recording).poses[-1, 2] / shift) / 2.0


@check(
    figure="landmark observed on both sides of the bearing pi: motion of landmark and robot [sigma]; for own "
    "association: difference of the corrections by landmarks behind and ahead [2 %]",
    bound=1.0,
    blame="the innovation of a bearing: wrap z - h(x) to (-pi, pi] before the gain, and before the distances of an "
    "association",
    after=("landmarks-behind", "update-bearing"),
)
def innovation_wrap(subject: Subject, rng: np.random.Generator) -> float:
    """Observe a landmark straight behind, just left and just right of the bearing pi."""
    start = np.append(rng.uniform(-3.0, 3.0, 2), 0.0)
    distance, side = rng.uniform(3.0, 6.0), rng.choice([-1.0, 1.0]) * 0.2 * SIGMA
    landmarks = around(start, np.array([distance]), np.array([np.pi]))
    world = at_rest(start, KNOWN_START, landmarks, ((1, 0), (2, 0)))
    if subject.ignores("ids"):
        return _lost_correction(subject, distance) / SAME_CORRECTION
    before, after = (subject(world.recording(np.array([[0.0, side], [0.0, last]]))) for last in (side, -side))
    unit = 10.0 * distance * SIGMA if subject.has_own_noise else KNOWN  # the start may be uncertain for its own noise
    moved = float(np.abs(after.poses[-1] - before.poses[-1]).max() / unit)
    if len(after.landmark_ids):
        moved = max(moved, float(np.linalg.norm(landmark_of(after, 0) - landmark_of(before, 0)) / (distance * SIGMA)))
    return moved


def _lost_correction(subject: Subject, distance: float) -> float:
    """Return the share of a correction that is lost if the landmark is behind and the bearing passes pi.

    A wrong innovation is far from every landmark, so that the filter adds another one and corrects nothing.
    """
    side = LOOSE / 2.0
    disturbance = np.array([[0.0, side], [0.0, -side]])
    ahead = subject(_imprecise_move(0.0, LOOSE, np.array([distance, 0.0])).recording(disturbance)).poses[-1, 2]
    behind_only = replace(subject)  # this check measures a confusion here
    behind = behind_only(_imprecise_move(0.0, LOOSE, np.array([-distance, 0.0])).recording(disturbance)).poses[-1, 2]
    return float(abs(behind - ahead) / max(abs(ahead), KNOWN))


CHECKS = (first_sight, cross_covariance, update_range, update_bearing, measurement_noise, innovation_wrap)
