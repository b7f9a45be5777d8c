"""Gauss-Newton steps to the minimum of a window's cost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window import passes
from slamgauge.ekf.advanced.window.cost import Prior, Problem, chain, rebase, twice_cost
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.se2 import mean_rotation, wrap

# Costs are compared as twice the cost, in squared standard deviations.
CLOSE = 0.01  # largest difference of actual and predicted cost after the last step
MAX_STEPS = 20
ACCEPTED_DECREASE = 1.0  # largest predicted decrease that may remain after MAX_STEPS
MAX_HALVINGS = 20  # halvings of one step


class NoMinimumError(Exception):
    """The steps do not converge to a minimum."""


class ForwardPass(NamedTuple):
    """Quadratic model of a step of the newest pose and the rest (see `advanced.window.passes.sweep`)."""

    A: Float  # (n, n) upper triangle
    b: Float  # (n,)
    work: passes.Pass
    decrease: float  # decrease of twice the cost by the noise of motions, without such a step


def forward_pass(problem: Problem) -> ForwardPass:
    """Run the forward pass over the window at the present estimate."""
    size = ROBOT + len(problem.rest)
    A, b, work = np.zeros((size, size)), np.zeros(size), passes.allocate_pass(len(problem.window.pose), size)
    return ForwardPass(A, b, work, passes.sweep(problem, A, b, work))


def symmetric(A: Float) -> Float:
    """Return the symmetric matrix with the upper triangle of A."""
    upper = np.triu(A)
    return upper + np.triu(upper, 1).T


def inverse(A: Float) -> Float:
    """Return the symmetric inverse of a covariance or information matrix, computed with a unit diagonal."""
    scale = 1.0 / np.sqrt(np.diag(A))
    scaled = np.asarray(np.linalg.inv(A * np.outer(scale, scale)), np.float64)
    return 0.5 * (scaled + scaled.T) * np.outer(scale, scale)


def minimise(problem: Problem) -> tuple[Problem, Float]:
    """Return the problem at the minimum of its cost, and the covariance (3, 3) of its newest pose.

    A step that increases the cost by more than CLOSE is halved. Steps end when the cost after a step is close to that
    predicted by the linear model, or after MAX_STEPS if the predicted decrease is small.

    Raises:
        numpy.linalg.LinAlgError: the measurements do not determine all unknowns in double precision.
        NoMinimumError: the steps do not converge.
    """
    size, cov = ROBOT + len(problem.rest), np.zeros((3, 3))
    step, cost, remaining = np.zeros(size), twice_cost(problem), np.inf
    for _ in range(MAX_STEPS):
        A, b, work, decrease = forward_pass(problem)
        if not passes.solve(size, A, b, step, cov):
            raise np.linalg.LinAlgError
        predicted = cost - decrease - float(b @ step)
        of_rest = step[ROBOT:].copy()
        passes.go_back(problem.window, size, step, work)
        for halvings in range(MAX_HALVINGS):
            moved = _moved(problem, 0.5**halvings, step[:ROBOT], of_rest, work.step)
            cost_after = twice_cost(moved)
            if cost_after <= cost + CLOSE:
                break
        else:
            remaining = cost - predicted
            break
        problem, remaining = _rebased(moved), cost - predicted
        if abs(cost_after - predicted) < CLOSE:
            return problem, cov
        cost = twice_cost(problem)
    if remaining < ACCEPTED_DECREASE:
        return problem, cov
    raise NoMinimumError


def _rebased(problem: Problem) -> Problem:
    """Return the problem with the present estimate as reference of the prior's errors."""
    prior = Prior(*(each.copy() for each in problem.prior))
    rebase(prior, problem.window.pose[0], problem.rest, problem.landmarks)
    return problem._replace(prior=prior)


def _moved(problem: Problem, part: float, of_first: Float, of_rest: Float, multipliers: Float) -> Problem:
    """Return the problem after a step: all points turn with the first pose, as in the errors of the prior.

    Args:
        problem: before the step.
        part: fraction of the step.
        of_first: (3,) step of the first pose.
        of_rest: (n-3,) step of landmarks and kept poses.
        multipliers: (k+1, 3) multipliers after a full step.
    """
    window, count = problem.window, problem.landmarks
    turn, of_poses = part * float(of_first[2]), part * of_rest[2 * count :].reshape(-1, 3)
    of_landmarks = _turned(part * of_rest[: 2 * count].reshape(-1, 2), turn)
    of_poses[:, :2] = _turned(of_poses[:, :2], turn)
    pose = window.pose.copy()
    pose[0, :2] += _turned(part * of_first[None, :2], turn)[0]
    pose[0, 2] = wrap(pose[0, 2] + turn)
    rest = problem.rest + np.concatenate([of_landmarks.ravel(), of_poses.ravel()])
    rest[2 * count + 2 :: 3] = wrap(rest[2 * count + 2 :: 3])
    multiplier = window.multiplier + part * (multipliers - window.multiplier)
    moved = problem._replace(window=window._replace(pose=pose, multiplier=multiplier), rest=rest)
    chain(moved.window)
    return moved


def _turned(steps: Float, turn: float) -> Float:
    """Return V(turn) step (k, 2) for steps (k, 2): a common rotation keeps the distances between points."""
    return steps @ mean_rotation(turn).T
