"""Laws of what a filter claims to know: prior, covariances, and what a robot that stands can learn of itself."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.law import Law, Subject
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    SIGMA,
    World,
    any_start,
    around,
    correlated,
    pose_error,
    relative_error,
    standing,
)

ALTERNATING = tuple((step, (step - 1) % 2) for step in range(1, 7))


def _prior(subject: Subject, rng: np.random.Generator) -> float:
    """Nothing is seen and nothing moves: the start is the prior."""
    world = standing(any_start(rng), correlated(np.array([0.3, 0.2, 0.1]), rng), np.ones((1, 2)), ((1, 0),))
    answer = subject(world.recording().first(0))
    worst = pose_error(answer.poses, world.poses[:1])
    if answer.estimate.pose_covs is not None:
        worst = max(worst, relative_error(answer.pose_covs[0], world.prior_cov))
    return worst


def _zero_prior(subject: Subject, rng: np.random.Generator) -> float:
    """The start is known exactly: two sights that differ by three sigmas move the landmark, never the robot."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    world = standing(start, np.zeros((3, 3)), landmarks, ((0, 0), (1, 0)))
    answer = subject(world.recording(3.0 * SIGMA * np.array([[0.0, 0.0], [1.0, -1.0]])))
    worst = pose_error(answer.poses, world.poses) / SIGMA
    if answer.estimate.pose_covs is not None:
        worst = max(worst, float(np.abs(answer.pose_covs).max()) / SIGMA**2)
    return worst


def _sound_covariances(subject: Subject, rng: np.random.Generator) -> float:
    """Loose odometry, sharp sights: an `Estimate` refuses what is not symmetric positive semi-definite by itself.

    What it cannot see is a variance that is gone: a heading lost by half a radian and found again by one bearing holds
    that bearing's variance and the landmark's, 2 R.
    """
    start = any_start(rng)
    steps, bearings = 30, np.array([0.2, -0.3])
    walk = World(
        start=start,
        prior_cov=KNOWN_START,
        moves=np.tile([0.1, 0.0], (steps, 1)),
        move_sigmas=np.tile([1000.0 * SIGMA, 10.0 * SIGMA], (steps, 1)),
        landmarks=around(start, rng.uniform(8.0, 9.0, 2), bearings),
        sights=tuple((step, step % 2) for step in range(steps + 1)),
    )
    _ = subject(walk.recording()).pose_covs
    return max(_found_again(subject, start, rng) for _ in range(4))


def _found_again(subject: Subject, start: Float, rng: np.random.Generator) -> float:
    """Relative difference to sqrt(2 R) of the heading's sigma, which is within a millionth of that."""
    lost = World(
        start=start,
        prior_cov=KNOWN_START,
        moves=np.zeros((2, 2)),
        move_sigmas=np.array([[0.0, 0.0], [0.0, rng.uniform(0.5, 1.0)]]),
        landmarks=around(start, rng.uniform(3.0, 6.0, 1), np.zeros(1)),
        sights=((1, 0), (2, 0)),
    )
    found = np.sqrt(subject(lost.recording()).pose_covs[-1, 2, 2])
    return float(abs(found / (np.sqrt(2.0) * SIGMA) - 1.0))


def _standing(subject: Subject, rng: np.random.Generator) -> float:
    """Two landmarks seen three times each with little noise: the pose stays where it was, and as uncertain."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 2), np.array([0.6, -0.6]) + rng.uniform(-0.3, 0.3, 2))
    world = standing(start, correlated(SIGMA * np.array([20.0, 20.0, 10.0]), rng), landmarks, ALTERNATING)
    answer = subject(world.recording(rng.normal(0.0, SIGMA, (len(ALTERNATING), 2))))
    sigmas = np.sqrt(np.diag(world.prior_cov))
    worst = float(np.abs((answer.poses[-1] - start) / sigmas).max())
    if answer.estimate.pose_covs is not None:
        worst = max(worst, relative_error(answer.pose_covs[-1], world.prior_cov))
    return worst


def _standing_in_noise(subject: Subject, rng: np.random.Generator) -> float:
    """Two landmarks seen sixty times each with much noise: the share of the heading's sigma that is lost."""
    sigma, heading = 0.05, 0.3
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 2), np.array([1.2, -1.2]) + rng.uniform(-0.3, 0.3, 2))
    sights = tuple((step, (step - 1) % 2) for step in range(1, 121))
    world = standing(start, np.diag([0.01, 0.01, heading**2]), landmarks, sights)
    recording = world.recording(rng.normal(0.0, sigma, (len(sights), 2)), sigma)
    return float(1.0 - np.sqrt(subject(recording).pose_covs[-1, 2, 2]) / heading)


BELIEF = (
    Law(
        name="prior-respected",
        figure="nothing moves, nothing is seen: largest difference of the start to the prior [m, rad, sigmas squared]",
        bound=1e-6,
        reason="the same numbers; only rounding may differ",
        blame="the start of the filter: it begins with prior_mean and prior_cov",
        judge=_prior,
    ),
    Law(
        name="zero-prior",
        figure="start known exactly, sights that differ: how far the robot moves, its variance, in a sight's sigmas",
        bound=1e-3,
        reason="the answer is 0; only rounding may differ",
        blame="the inverse of a covariance that may be zero: invert S = H P H' + R, never P",
        judge=_zero_prior,
    ),
    Law(
        name="sound-covariances",
        figure="sights far sharper than odometry, P sound throughout: relative difference of a sigma to its answer",
        bound=0.05,
        reason="rounding in double precision leaves 1e-6; in single precision nothing of the sigma is sure",
        blame="precision or form of P after the update: double precision, then P = (P + P')/2 or Joseph's form",
        judge=_sound_covariances,
    ),
    Law(
        name="standing-robot",
        figure="robot that stands, little noise: change of its pose in sigmas and of its covariance in sigmas squared",
        bound=0.02,
        reason="second order: of each sight 1e-4 is taken for news of the heading",
        blame="what ties a landmark to where it was first seen from: cross-covariance, J_r, or unlike columns in H",
        judge=_standing,
    ),
    Law(
        name="standing-robot-in-noise",
        figure="robot that stands, much noise: share of the heading's sigma that is lost",
        bound=0.01,
        reason="landmarks first seen from here say nothing about here",
        blame="Jacobians of one landmark taken at different places: each says something else about the heading",
        judge=_standing_in_noise,
        excused_to=1.0,
        limit="the textbook EKF gains a heading from nothing, as its Jacobians move with the estimate (Julier and "
        "Uhlmann 2001); fej-ekf, oc-ekf and riekf do not",
    ),
)
