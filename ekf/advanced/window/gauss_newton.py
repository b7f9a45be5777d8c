"""Gauss-Newton steps to where the cost of a window is least."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window import kernels as passes
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.se2 import mean_rotation, wrap

CLOSE = 0.01  # squared standard deviations between twice the cost and what a step was to make of it: it was the last
MOST = 20  # steps
BESIDE = 1.0  # squared standard deviations that twice the cost may still have to fall by after the last of them
MOST_HALVINGS = 20  # of one


class NoMinimumError(Exception):
    """Steps do not end where the cost is least."""


class Swept(NamedTuple):
    """What the window says of steps of its newest pose and the rest (see `advanced.window.kernels.sweep`)."""

    A: Float  # (n, n) upper triangle
    b: Float  # (n,)
    work: passes.Pass
    fallen: float  # by so much twice the cost falls by the noise of motions


def swept(problem: passes.Problem) -> Swept:
    """A pass over the window where it stands."""
    size = ROBOT + len(problem.rest)
    A, b, work = np.zeros((size, size)), np.zeros(size), passes.allocate_pass(len(problem.window.pose), size)
    return Swept(A, b, work, passes.sweep(problem, A, b, work))


def symmetric(A: Float) -> Float:
    """Both triangles of what is given by its upper one."""
    upper = np.triu(A)
    return upper + np.triu(upper, 1).T


def inverse(A: Float) -> Float:
    """A^-1 of a covariance or its inverse, symmetric; scaled to ones on the diagonal in between."""
    scale = 1.0 / np.sqrt(np.diag(A))
    scaled = np.asarray(np.linalg.inv(A * np.outer(scale, scale)), np.float64)
    return 0.5 * (scaled + scaled.T) * np.outer(scale, scale)


def descended(problem: passes.Problem) -> tuple[passes.Problem, Float]:
    """The problem where its cost is least, and the covariance (3, 3) of its newest pose.

    A step that raises the cost, by more than does not matter, is halved. The last is one that does what its linear
    model says, and so ends where that model's cost is least; or, of many, one that lacks less than a deviation.

    Raises:
        numpy.linalg.LinAlgError: what is known does not determine everything, in double precision.
        NoMinimumError: the steps do not end.
    """
    size, cov = ROBOT + len(problem.rest), np.zeros((3, 3))
    step, cost, to_fall = np.zeros(size), passes.cost(problem), np.inf
    for _ in range(MOST):
        A, b, work, fallen = swept(problem)
        if not passes.solve(size, A, b, step, cov):
            raise np.linalg.LinAlgError
        expected = cost - fallen - float(b @ step)
        of_rest = step[ROBOT:].copy()
        passes.go_back(problem.window, size, step, work)
        for halvings in range(MOST_HALVINGS):
            moved = _moved(problem, 0.5**halvings, step[:ROBOT], of_rest, work.step)
            cost_there = passes.cost(moved)
            if cost_there <= cost + CLOSE:
                break
        else:
            to_fall = cost - expected
            break
        problem, to_fall = _rebased(moved), cost - expected
        if abs(cost_there - expected) < CLOSE:
            return problem, cov
        cost = passes.cost(problem)
    if to_fall < BESIDE:
        return problem, cov
    raise NoMinimumError


def _rebased(problem: passes.Problem) -> passes.Problem:
    """The same with the prior's errors counted from where it stands."""
    prior = passes.Prior(*(each.copy() for each in problem.prior))
    passes.rebase(prior, problem.window.pose[0], problem.rest, problem.landmarks)
    return problem._replace(prior=prior)


def _moved(problem: passes.Problem, part: float, of_first: Float, of_rest: Float, multipliers: Float) -> passes.Problem:
    """A step taken, or part of it: all points turn with the first pose, as errors of the prior do.

    Args:
        problem: where it stands.
        part: how much of the step.
        of_first: (3,) the step of the first pose.
        of_rest: (n-3,) the step of landmarks and kept poses.
        multipliers: (k+1, 3) that are sought.
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
    passes.chain(moved.window)
    return moved


def _turned(steps: Float, turn: float) -> Float:
    """V(turn) step, (k, 2), of steps (k, 2): what is moved and turned so keeps its distances."""
    return steps @ mean_rotation(turn).T
