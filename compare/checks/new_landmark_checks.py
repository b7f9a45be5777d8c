"""Laws of a new landmark: its covariance, and what ties it to the robot."""

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
    relative_error,
    standing,
)


def sight_jacobian(start: Float, landmark: Float) -> Float:
    """(2, 2) of the landmark's place with respect to range and bearing."""
    dx, dy = landmark - start[:2]
    return np.array([[dx, -dy], [dy, dx]]) / [np.hypot(dx, dy), 1.0]


def _covariance(subject: Subject, rng: np.random.Generator) -> float:
    """A landmark seen once from an uncertain pose: J_r P J_r' + J_z R J_z'."""
    start = any_start(rng)
    landmarks = around(start, rng.uniform(3.0, 6.0, 1), rng.uniform(-1.0, 1.0, 1))
    world = standing(start, correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng), landmarks, ((1, 0),))
    dx, dy = landmarks[0] - start[:2]
    Jr, Jz = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]]), sight_jacobian(start, landmarks[0])
    right = Jr @ world.prior_cov @ Jr.T + SIGMA**2 * Jz @ Jz.T
    return relative_error(subject(world.recording()).landmark_cov(0), right)


def _cross_covariance(subject: Subject, rng: np.random.Generator) -> float:
    """A landmark first seen from an unsure place must follow when a known one tells where that was.

    Landmark 0 is seen from the known start. A noisy move along x leads to where landmark 1 is first seen. Then a range
    to landmark 0 moves the robot; whatever its gain, landmark 1 must move by the same.
    """
    sigma = 50.0 * SIGMA
    landmarks = np.array([[rng.uniform(6.0, 9.0), 0.0], [rng.uniform(3.0, 5.0), rng.uniform(1.0, 3.0)]])
    world = World(
        start=np.zeros(3),
        prior_cov=KNOWN_START,
        moves=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]),
        move_sigmas=np.array([[0.0, 0.0], [sigma, 0.0], [0.0, 0.0]]),
        landmarks=landmarks,
        sights=((1, 0), (2, 1), (3, 0)),
    )
    shift = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * sigma
    recording = world.recording(np.array([[0.0, 0.0], [0.0, 0.0], [shift, 0.0]]))
    before, after = subject(recording.first(2)), subject(recording)
    robot = after.poses[-1, :2] - before.poses[-1, :2]
    landmark = after.landmark(1) - before.landmark(1)
    return float(np.linalg.norm(landmark - robot) / abs(shift))


FIRST_SIGHT = (
    Law(
        name="first-sight",
        figure="covariance of a landmark seen once, largest difference to J_r P J_r' + J_z R J_z' in sigmas squared",
        bound=1e-3,
        reason="exact for every filter of first order; sigmas of 1e-4 rad bend by 1e-4 at most",
        blame="the Jacobians of a new landmark: J_r with respect to the pose, heading included, J_z to the sight",
        judge=_covariance,
    ),
    Law(
        name="cross-covariance",
        figure="robot corrected after a first sight: what the landmark lacks of following, relative to the correction",
        bound=0.02,
        reason="what the landmark's own sight adds is 1/2500; second order less",
        blame="the cross-covariance of a new landmark with the rest of the state: P_new,: = J_r P_r,:",
        judge=_cross_covariance,
    ),
)
