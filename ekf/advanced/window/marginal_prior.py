"""Prior of a window on its first pose and the rest: landmarks and kept poses.

All functions return a new prior and leave their arguments unchanged.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window import passes
from slamgauge.ekf.advanced.window.cost import Prior, Problem, observations_of
from slamgauge.ekf.advanced.window.gauss_newton import inverse, symmetric
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.se2 import rotation

# Regularising noise where the inverse of a singular covariance is needed: for a motion the larger of both.
REGULARISING_SIGMA = 1e-6  # standard deviation [m or rad]
REGULARISING_SHARE = 1e-3  # share of the other noise of the motion


def of_start(pose: Float, cov: Float) -> Prior:
    """Return the prior of a start pose (3,) with covariance (3, 3), which may be singular."""
    return _prior_of(pose, np.zeros(0), 0, inverse(cov + REGULARISING_SIGMA**2 * np.eye(3)), np.zeros(3))


def with_landmark(prior: Prior, landmarks: int, place: Float) -> Prior:
    """Return the prior with an additional last landmark at `place` (2,), about which it has no information."""
    rows = [ROBOT + 2 * landmarks] * 2
    information = np.insert(np.insert(prior.information, rows, 0.0, axis=0), rows, 0.0, axis=1)
    return Prior(information, np.insert(prior.gradient, rows, 0.0), np.insert(prior.at, rows[0], place))


def without_first(problem: Problem) -> Prior:
    """Return the prior of the second pose and the rest: the first pose, its scan and its motion are marginalised."""
    A, b = _known_of_first(problem)
    passes.move_on(problem.window, 1, len(b), A, b, passes.allocate_pass(2, len(b)))
    return _prior_of(problem.window.pose[1], problem.rest, problem.landmarks, A, b)


def with_first_kept(problem: Problem) -> tuple[Prior, Float]:
    """Return the prior of the second pose and the rest, and the rest (n,): the first pose is kept as its last entry.

    Directions of the motion without noise get regularising noise.
    """
    A, b = _known_of_first(problem)
    size, (before, after) = len(b), problem.window.pose[:2]
    F, G = np.eye(3), np.eye(3)
    F[:2, 2] = before[1] - after[1], after[0] - before[0]
    G[:2, :2] = rotation(before[2])
    Q = problem.window.root[1] @ problem.window.root[1].T
    variances = np.array([Q[0, 0] + Q[1, 1], Q[0, 0] + Q[1, 1], Q[2, 2]])
    regularising = np.maximum(REGULARISING_SHARE**2 * variances, REGULARISING_SIGMA**2)
    weight = inverse(G @ Q @ G.T + np.diag(regularising))
    tie = np.zeros((3, size + 3))  # d_1 - F d_0
    tie[:, :3], tie[:, size:] = np.eye(3), -F
    order = np.r_[size : size + 3, 3:size, 0:3]  # the second pose, the rest, the first pose
    information, pull = np.zeros((size + 3, size + 3)), np.zeros(size + 3)
    information[:size, :size], pull[:size] = symmetric(A), b
    information = information[np.ix_(order, order)] + tie.T @ weight @ tie
    pull = pull[order] - tie.T @ (weight @ (G @ (Q @ problem.window.multiplier[1])))
    rest = np.concatenate([problem.rest, before])
    return _prior_of(after, rest, problem.landmarks, information, pull), rest


def without_kept(problem: Problem, which: int) -> tuple[Prior, Float]:
    """Return the prior and the rest (n,) after the kept pose `which` and its observations are marginalised."""
    pose, first = problem.window.pose[0], 2 * problem.landmarks + 3 * which
    size = ROBOT + len(problem.rest)
    A, b = np.zeros((size, size)), np.zeros(size)
    passes.add_prior(problem.prior, pose, problem.rest, problem.landmarks, A, b)
    kept = problem.rest[first : first + 3]
    observed = observations_of(problem.kept, which)
    passes.add_observations(observed, kept, ROBOT + first, problem.rest, A, b)
    A, gone = symmetric(A), ROBOT + first + np.arange(3)
    stay = np.delete(np.arange(size), gone)
    answer = np.linalg.solve(A[np.ix_(gone, gone)], np.column_stack([A[np.ix_(gone, stay)], b[gone]]))
    information = A[np.ix_(stay, stay)] - A[np.ix_(stay, gone)] @ answer[:, :-1]
    rest = np.delete(problem.rest, first + np.arange(3))
    pull = b[stay] - A[np.ix_(stay, gone)] @ answer[:, -1]
    return _prior_of(pose, rest, problem.landmarks, information, pull), rest


def _known_of_first(problem: Problem) -> tuple[Float, Float]:
    size = ROBOT + len(problem.rest)
    A, b = np.zeros((size, size)), np.zeros(size)
    passes.add_first(problem, A, b)
    return A, b


def _prior_of(pose: Float, rest: Float, landmarks: int, A: Float, b: Float) -> Prior:
    prior = Prior(np.zeros_like(A), np.zeros_like(b), np.zeros_like(b))
    passes.set_prior(pose, rest, landmarks, A, b, prior)
    return prior
