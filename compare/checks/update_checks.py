"""Laws of the correction: one update in closed form."""

from __future__ import annotations

import numpy as np

from slamgauge.compare.checks.law import Law, Subject
from slamgauge.compare.checks.new_landmark_checks import sight_jacobian
from slamgauge.compare.checks.small_recordings import KNOWN, KNOWN_START, SIGMA, World, any_start, around, standing

LOOSE = 50.0 * SIGMA  # sigma of a move, against which a sight is as good as exact


def _landmark_halfway(subject: Subject, rng: np.random.Generator, channel: int) -> float:
    """A landmark seen twice from a known place: it goes halfway towards the second sight, and its variance halves."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    shift = np.zeros((2, 2))
    shift[1, channel] = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 3.0) * SIGMA
    answer = subject(standing(start, KNOWN_START, landmarks, ((1, 0), (2, 0))).recording(shift))
    if not answer.has_map:
        return 0.0
    to_sight = np.linalg.inv(sight_jacobian(start, landmarks[0]))
    worst = np.abs(to_sight @ (answer.landmark(0) - landmarks[0]) / shift[1, channel] - np.eye(2)[channel] / 2).max()
    if answer.estimate.landmark_covs is not None:
        variance = (to_sight @ answer.landmark_cov(0) @ to_sight.T)[channel, channel]
        worst = max(worst, abs(variance / SIGMA**2 - 0.5))
    return float(worst)


def _loose_move(rng: np.random.Generator, forward_sigma: float, turn_sigma: float) -> World:
    """A landmark ahead, seen from a known start and again after a move along x with that noise."""
    return World(
        start=np.zeros(3),
        prior_cov=KNOWN_START,
        moves=np.array([[0.0, 0.0], [0.0, 0.0]]),
        move_sigmas=np.array([[0.0, 0.0], [forward_sigma, turn_sigma]]),
        landmarks=np.array([[rng.uniform(3.0, 6.0), 0.0]]),
        sights=((1, 0), (2, 0)),
    )


def _range(subject: Subject, rng: np.random.Generator) -> float:
    """A range moves the landmark halfway, and a robot that is lost along x by the whole of it."""
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    recording = _loose_move(rng, LOOSE, 0.0).recording(np.array([[0.0, 0.0], [shift, 0.0]]))
    robot = abs(subject(recording).poses[-1, 0] / shift + 1.0)
    return max(float(robot), _landmark_halfway(subject, rng, 0))


def _bearing(subject: Subject, rng: np.random.Generator) -> float:
    """A bearing moves the landmark halfway, and a heading that is lost by the whole of it."""
    shift = rng.choice([-1.0, 1.0]) * LOOSE
    recording = _loose_move(rng, 0.0, LOOSE).recording(np.array([[0.0, 0.0], [0.0, shift]]))
    robot = abs(subject(recording).poses[-1, 2] / shift + 1.0)
    return max(float(robot), _landmark_halfway(subject, rng, 1))


def _noise(subject: Subject, rng: np.random.Generator) -> float:
    """A lost heading found again by a bearing holds that bearing's variance and the landmark's: 2 R."""
    answer = subject(_loose_move(rng, 0.0, LOOSE).recording())
    right = np.sqrt(1.0 / (1.0 / LOOSE**2 + 1.0 / (2.0 * SIGMA**2)))
    return float(abs(np.sqrt(answer.pose_covs[-1, 2, 2]) / right - 1.0))


def _innovation_wrap(subject: Subject, rng: np.random.Generator) -> float:
    """A landmark straight behind, seen once on either side of the cut: it hardly moves, and neither does the robot."""
    start = np.append(rng.uniform(-3.0, 3.0, 2), 0.0)
    distance, side = rng.uniform(3.0, 6.0), rng.choice([-1.0, 1.0]) * 0.2 * SIGMA
    landmarks = around(start, np.array([distance]), np.array([np.pi]))
    world = standing(start, KNOWN_START, landmarks, ((1, 0), (2, 0)))
    before, after = (subject(world.recording(np.array([[0.0, side], [0.0, last]]))) for last in (side, -side))
    moved = float(np.abs(after.poses[-1] - before.poses[-1]).max() / KNOWN)
    if after.has_map:
        moved = max(moved, float(np.linalg.norm(after.landmark(0) - before.landmark(0)) / (distance * SIGMA)))
    return moved


UPDATE = (
    Law(
        name="update-range",
        figure="one range: largest difference of landmark, its variance and robot to the closed form, relative",
        bound=0.01,
        reason="what a move of 50 sigmas leaves of 1 is 1/1250; second order is less",
        blame="the row of H for the range, the gain, or P after the update: dr = ((l - p)/r)'(dl - dp), P = P - K S K'",
        judge=_range,
    ),
    Law(
        name="update-bearing",
        figure="one bearing: largest difference of landmark, its variance and robot to the closed form, relative",
        bound=0.01,
        reason="what a move of 50 sigmas leaves of 1 is 1/1250; second order is less",
        blame="the row of H for a bearing, or the gain: (-dy, dx)/r^2 for a landmark, its opposite and -1 for the pose",
        judge=_bearing,
    ),
    Law(
        name="measurement-noise",
        figure="sigma of a heading found again by one bearing, relative difference to sqrt(2 R)",
        bound=0.01,
        reason="second order; the start is known by a thousandth of R's sigma",
        blame="R in the innovation covariance: S = H P H' + R, with observation_cov as it is (variances)",
        judge=_noise,
    ),
    Law(
        name="innovation-wrap",
        figure="landmark seen on both sides of the bearing pi: how far it and the robot move, in sigmas",
        bound=1.0,
        reason="the answer is 0.2 of a sigma; an innovation of a whole turn moves it by 30 000",
        blame="the innovation of a bearing: bring z - h(x) into (-pi, pi] before the gain",
        judge=_innovation_wrap,
    ),
)
