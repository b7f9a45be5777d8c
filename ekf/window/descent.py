"""Gauss-Newton steps to where the cost of a window is least."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels import window as passes
from slamgauge.ekf.kernels.belief import ROBOT

CLOSE = 0.01  # squared standard deviations between twice the cost and what a step was to make of it: it was the last
MOST = 50  # steps
MOST_HALVINGS = 20  # of one


class NoMinimumError(Exception):
    """Steps do not end where the cost is least."""


class Swept(NamedTuple):
    """What the window says of steps of its newest pose and the rest (see `kernels.window.sweep`)."""

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
    """A^-1."""
    return np.asarray(np.linalg.inv(A), np.float64)


def descended(problem: passes.Problem) -> tuple[passes.Problem, Float]:
    """The problem where its cost is least, and the covariance (3, 3) of its newest pose.

    A step that raises the cost is halved. The last is one that does what its linear model says, and so ends where that
    model's cost is least.

    Raises:
        numpy.linalg.LinAlgError: what is known does not determine everything, in double precision.
        NoMinimumError: the steps do not end.
    """
    size, cov = ROBOT + len(problem.rest), np.zeros((3, 3))
    step, cost = np.zeros(size), passes.cost(problem)
    for _ in range(MOST):
        A, b, work, fallen = swept(problem)
        if not passes.solve(size, A, b, step, cov):
            raise np.linalg.LinAlgError
        expected = cost - fallen - float(b @ step)
        turn, of_rest = float(step[2]), step[ROBOT:].copy()
        passes.go_back(problem.window, size, step, work)
        for halvings in range(MOST_HALVINGS):
            moved = _moved(problem, 0.5**halvings, step[:ROBOT], turn, of_rest, work.step)
            cost_there = passes.cost(moved)
            if cost_there <= cost + CLOSE:
                break
        else:
            break
        problem, cost = moved, cost_there
        if abs(cost - expected) < CLOSE:
            return problem, cov
    raise NoMinimumError


def _moved(
    problem: passes.Problem, part: float, of_first: Float, turn: float, of_rest: Float, multipliers: Float
) -> passes.Problem:
    """A step taken, or part of it.

    Args:
        problem: where it stands.
        part: how much of the step.
        of_first: (3,) the step of the first pose.
        turn: of the newest pose, and with it of the landmarks.
        of_rest: (n-3,) the step of landmarks and kept poses.
        multipliers: (k+1, 3) that are sought.
    """
    window, count = problem.window, problem.landmarks
    of_poses = part * of_rest[2 * count :].reshape(-1, 3)
    of_landmarks = _turned(part * of_rest[: 2 * count].reshape(-1, 2), np.full(count, part * turn))
    of_poses[:, :2] = _turned(of_poses[:, :2], of_poses[:, 2])
    pose = window.pose.copy()
    pose[0, :2] += _turned(part * of_first[None, :2], part * of_first[2:])[0]
    pose[0, 2] += part * of_first[2]
    multiplier = window.multiplier + part * (multipliers - window.multiplier)
    moved = problem._replace(
        window=window._replace(pose=pose, multiplier=multiplier),
        rest=problem.rest + np.concatenate([of_landmarks.ravel(), of_poses.ravel()]),
    )
    passes.chain(moved.window)
    return moved


def _turned(steps: Float, turns: Float) -> Float:
    """V(turn) step, (k, 2), of steps (k, 2) and turns (k,): what is moved and turned by them keeps its distances."""
    half = 0.5 * turns
    along, across = np.sinc(turns / np.pi), np.sin(half) * np.sinc(half / np.pi)
    return np.column_stack([along * steps[:, 0] - across * steps[:, 1], across * steps[:, 0] + along * steps[:, 1]])
