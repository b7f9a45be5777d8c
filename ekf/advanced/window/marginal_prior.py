"""What is known from before a window: a prior on its first pose and the rest, and what changes it.

Each of these returns a new prior and leaves the one that it is given as it was.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window import kernels as passes
from slamgauge.ekf.advanced.window.gauss_newton import inverse, symmetric
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.se2 import rotation

LENT = 1e-6  # m or rad, standard deviation lent to what is known exactly where its information is needed,
SLIP = 1e-3  # or this share of the other noise of a motion, if that is more


def of_start(pose: Float, cov: Float) -> passes.Prior:
    """The prior of a start pose (3,) with covariance (3, 3), which may be singular."""
    return _prior_of(pose, np.zeros(0), 0, inverse(cov + LENT**2 * np.eye(3)), np.zeros(3))


def with_landmark(prior: passes.Prior, landmarks: int, place: Float) -> passes.Prior:
    """The prior with a landmark (2,) more, the last of them, of which it says nothing."""
    rows = [ROBOT + 2 * landmarks] * 2
    information = np.insert(np.insert(prior.information, rows, 0.0, axis=0), rows, 0.0, axis=1)
    return passes.Prior(information, np.insert(prior.gradient, rows, 0.0), np.insert(prior.at, rows[0], place))


def without_first(problem: passes.Problem) -> passes.Prior:
    """The prior of the second pose and the rest: the first is eliminated, with its scan and its motion."""
    A, b = _known_of_first(problem)
    passes.move_on(problem.window, 1, len(b), A, b, passes.allocate_pass(2, len(b)))
    return _prior_of(problem.window.pose[1], problem.rest, problem.landmarks, A, b)


def with_first_kept(problem: passes.Problem) -> tuple[passes.Prior, Float]:
    """The prior of the second pose and the rest, the first among the rest (n,), which is returned, too.

    Where the motion between them has no noise some is lent to it.
    """
    A, b = _known_of_first(problem)
    size, (before, after) = len(b), problem.window.pose[:2]
    F, G = np.eye(3), np.eye(3)
    F[:2, 2] = before[1] - after[1], after[0] - before[0]
    G[:2, :2] = rotation(before[2])
    Q = problem.window.root[1] @ problem.window.root[1].T
    lent = np.maximum(SLIP**2 * np.array([Q[0, 0] + Q[1, 1], Q[0, 0] + Q[1, 1], Q[2, 2]]), LENT**2)
    weight = inverse(G @ Q @ G.T + np.diag(lent))
    tie = np.zeros((3, size + 3))  # d_1 - F d_0
    tie[:, :3], tie[:, size:] = np.eye(3), -F
    order = np.r_[size : size + 3, 3:size, 0:3]  # the second pose, the rest, the first pose
    information, pull = np.zeros((size + 3, size + 3)), np.zeros(size + 3)
    information[:size, :size], pull[:size] = symmetric(A), b
    information = information[np.ix_(order, order)] + tie.T @ weight @ tie
    pull = pull[order] - tie.T @ (weight @ (G @ (Q @ problem.window.multiplier[1])))
    rest = np.concatenate([problem.rest, before])
    return _prior_of(after, rest, problem.landmarks, information, pull), rest


def without_kept(problem: passes.Problem, which: int) -> tuple[passes.Prior, Float]:
    """The prior with what the kept pose `which` has seen, and without that pose; and the rest (n,) without it."""
    pose, first = problem.window.pose[0], 2 * problem.landmarks + 3 * which
    size = ROBOT + len(problem.rest)
    A, b = np.zeros((size, size)), np.zeros(size)
    passes.add_prior(problem.prior, pose, problem.rest, problem.landmarks, A, b)
    kept = problem.rest[first : first + 3]
    observed = passes.observations_of(problem.kept, which)
    passes.add_observations(observed, kept, ROBOT + first, problem.rest, A, b)
    A, gone = symmetric(A), ROBOT + first + np.arange(3)
    stay = np.delete(np.arange(size), gone)
    answer = np.linalg.solve(A[np.ix_(gone, gone)], np.column_stack([A[np.ix_(gone, stay)], b[gone]]))
    information = A[np.ix_(stay, stay)] - A[np.ix_(stay, gone)] @ answer[:, :-1]
    rest = np.delete(problem.rest, first + np.arange(3))
    pull = b[stay] - A[np.ix_(stay, gone)] @ answer[:, -1]
    return _prior_of(pose, rest, problem.landmarks, information, pull), rest


def _known_of_first(problem: passes.Problem) -> tuple[Float, Float]:
    size = ROBOT + len(problem.rest)
    A, b = np.zeros((size, size)), np.zeros(size)
    passes.add_first(problem, A, b)
    return A, b


def _prior_of(pose: Float, rest: Float, landmarks: int, A: Float, b: Float) -> passes.Prior:
    prior = passes.Prior(np.zeros_like(A), np.zeros_like(b), np.zeros_like(b))
    passes.set_prior(pose, rest, landmarks, A, b, prior)
    return prior
