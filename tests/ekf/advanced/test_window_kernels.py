"""Jacobians of a window's cost compared with differences, at difficult states."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window import passes
from slamgauge.ekf.advanced.window.cost import (
    Observed,
    ObservedByPose,
    Prior,
    Problem,
    Window,
    chain,
    heading_lever,
    observation_error,
    prior_error,
    rebase,
    twice_cost,
)
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.se2 import rotation, wrap
from slamgauge.sensor_kernels import BEARING, POSITION, RANGE_BEARING
from tests.reference.jacobians import assert_jacobian, differentiate

pytestmark = pytest.mark.slow

PI = math.pi
SENSORS = pytest.mark.parametrize("sensor", [RANGE_BEARING, POSITION, BEARING])
HEADINGS = pytest.mark.parametrize("heading", [0.0, PI, -PI + 1e-9, -2.5])


def root_of(sensor: int) -> Float:
    root = np.array([[3.0, 0.4], [0.0, 9.0]])
    return root * [[0.0], [1.0]] if sensor == BEARING else root


@SENSORS
@HEADINGS
@pytest.mark.parametrize("distance", [0.02, 3.0, 200.0])
@pytest.mark.parametrize("bearing", [0.3, PI, -2.0])
def test_the_residual_of_an_observation(sensor: int, heading: float, distance: float, bearing: float) -> None:
    pose = np.array([1.0, -2.0, heading])
    landmark = pose[:2] + rotation(heading) @ (distance * np.array([math.cos(bearing), math.sin(bearing)]))
    value = landmark - pose[:2] if sensor == POSITION else np.array([distance + 0.1, bearing - 0.05])

    observed = Observed(sensor, np.zeros(1, np.int64), value[None], root_of(sensor)[None])

    def residual(at: Float) -> Float:
        r = np.zeros(2)
        observation_error(observed, 0, at[:3], at[3:], r, np.zeros((2, 5)))
        return r

    r, H = np.zeros(2), np.zeros((2, 5))
    observation_error(observed, 0, pose, landmark, r, H)
    step = 1e-3 * np.minimum(distance, 1.0)
    scale = max(1.0, 1.0 / distance)
    at = np.concatenate([pose, landmark])
    assert_jacobian(residual, H, at, step=[step, step, 1e-3, step, step], tolerance=3e-9 * scale)


@SENSORS
def test_a_landmark_at_the_robot_gives_no_bearing_information(sensor: int) -> None:
    r, H = np.zeros(2), np.zeros((2, 5))
    observed = Observed(sensor, np.zeros(1, np.int64), np.array([[0.5, 1.0]]), np.eye(2)[None])
    observation_error(observed, 0, np.zeros(3), np.zeros(2), r, H)
    if sensor == POSITION:
        np.testing.assert_array_equal(r, [-0.5, -1.0])
    else:
        assert not r.any()
        assert not H.any()


@HEADINGS
def test_the_errors_of_the_prior(heading: float) -> None:
    """At the reference their Jacobian is the unit matrix except for the column of the heading."""
    rng = np.random.default_rng(0)
    landmarks, size = 2, ROBOT + 2 * 2 + 2 * 3
    at = rng.normal(scale=5.0, size=size)
    at[2], at[9] = heading, PI - 1e-4
    prior = Prior(np.eye(size), np.zeros(size), at)

    def errors(values: Float) -> Float:
        error = np.zeros(size)
        prior_error(prior, values[:3], values[3:], landmarks, error)
        return error

    lever, expected = np.zeros(size), np.eye(size)
    heading_lever(at[:3], at[3:], landmarks, lever)
    expected[:, 2] = -lever
    expected[2, 2] = 1.0
    assert_jacobian(errors, expected, at, angles=(2, 9, 12))


def test_a_prior_equals_the_factors_that_it_replaces() -> None:
    """For steps from its reference; moving everything changes only the heading error of x_0."""
    problem = some_problem(RANGE_BEARING)
    size = ROBOT + len(problem.rest)
    A, b = np.zeros((size, size)), np.zeros(size)
    passes.add_first(problem, A, b)
    prior = Prior(np.zeros((size, size)), np.zeros(size), np.zeros(size))
    passes.set_prior(problem.window.pose[0], problem.rest, 2, A, b, prior)
    again, pull = np.zeros((size, size)), np.zeros(size)
    passes.add_prior(prior, problem.window.pose[0], problem.rest, 2, again, pull)
    np.testing.assert_allclose(np.triu(again), np.triu(A), rtol=1e-12, atol=1e-12 * np.abs(A).max())
    np.testing.assert_allclose(pull, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())

    turn = 2.0
    there = np.concatenate([problem.window.pose[0], problem.rest])
    for x in (0, 3, 5, 7):
        there[x : x + 2] = rotation(turn) @ there[x : x + 2]
    there[[2, 9]] += turn
    error = np.zeros(size)
    prior_error(prior, there[:3], there[3:], 2, error)
    np.testing.assert_allclose(error, float(wrap(turn)) * np.eye(size)[2], atol=1e-12)


def test_a_prior_does_not_depend_on_its_reference() -> None:
    """The minimum does not depend on the reference of the errors."""
    problem = some_problem(RANGE_BEARING)
    size = ROBOT + len(problem.rest)
    prior = Prior(*(each.copy() for each in problem.prior))
    at, step = problem.prior.at, np.linalg.solve(problem.prior.information, problem.prior.gradient)
    rebase(prior, at[:3] + np.array([0.3, -0.1, 0.0]), at[3:], 2)
    moved = np.linalg.solve(prior.information, prior.gradient)
    np.testing.assert_allclose(moved, step - [0.3, -0.1, *np.zeros(size - 2)], atol=1e-9)


def some_problem(sensor: int) -> Problem:
    """Return three poses, two landmarks, a kept pose, and observations of all."""
    rng = np.random.default_rng(1)
    size, rest = ROBOT + 4 + 3, np.array([3.0, 1.0, -1.0, 4.0, -2.0, -1.0, 3.1])
    root = rng.normal(size=(size, size))
    increments = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.2], [0.4, 0.1, -0.1]])
    roots = np.tile(np.diag([0.2, 0.0, 0.1]), (3, 1, 1))
    window = Window(np.zeros((3, 3)), 2.0 * rng.normal(size=(3, 3)), increments, roots)
    window.pose[0] = 0.2, -0.1, 3.0
    chain(window)
    at = np.concatenate([window.pose[0], rest])
    prior = Prior(root @ root.T, rng.normal(size=size), at)
    roots = np.tile(root_of(sensor), (4, 1, 1))
    four = Observed(sensor, np.array([0, 1, -1, 0]), rng.uniform(1, 3, (4, 2)), roots)
    one = Observed(sensor, np.array([1]), rng.uniform(1, 3, (1, 2)), roots[:1])
    seen = ObservedByPose(np.array([0, 1, 3, 4]), four)
    kept = ObservedByPose(np.array([0, 1]), one)
    return Problem(prior, window, seen, kept, rest, 2)


@SENSORS
def test_a_pass_finds_gradient_and_minimum(sensor: int) -> None:
    """Compared with differences of the cost over all unknowns."""
    problem = some_problem(sensor)
    free = [0, 2]  # rows with motion noise: no slip
    first, count = ROBOT + len(problem.rest), len(problem.window.pose)

    def at(step: Float) -> Problem:
        moved = problem._replace(rest=problem.rest + step[3:first])
        moved = moved._replace(window=problem.window._replace(pose=problem.window.pose.copy()))
        moved.window.pose[0] += step[:3]
        multipliers = problem.window.multiplier.copy()
        for i in range(1, count):
            multipliers[i, free] += step[first + 2 * (i - 1) : first + 2 * i]
        moved = moved._replace(window=moved.window._replace(multiplier=multipliers))
        chain(moved.window)
        return moved

    def newest(step: Float) -> Float:
        return at(step).window.pose[-1]

    zero = np.zeros(first + 2 * (count - 1))
    gradient = differentiate(lambda step: np.array([twice_cost(at(step))]), zero, 1e-4)[0]
    A, b = np.zeros((first, first)), np.zeros(first)
    work, step, cov = passes.allocate_pass(count, first), np.zeros(first), np.zeros((3, 3))
    fallen = passes.sweep(problem, A, b, work)
    assert passes.solve(first, A, b, step, cov)
    of_newest, fallen = step[:3].copy(), fallen + b @ step
    passes.go_back(problem.window, first, step, work)
    whole = np.concatenate([step, (work.step - problem.window.multiplier)[1:, free].ravel()])

    # a Gauss-Newton step uses the squared Jacobians, without the curvature of residuals
    assert gradient @ whole < 0.0
    curvature = gauss_newton_matrix(at, zero)
    np.testing.assert_allclose(curvature @ whole, -gradient / 2.0, atol=1e-6 * np.abs(gradient).max())
    J = differentiate(newest, zero, 1e-4, angles=(2,))
    np.testing.assert_allclose(J @ whole, of_newest, atol=1e-8)
    np.testing.assert_allclose(J @ np.linalg.inv(curvature) @ J.T, cov, rtol=1e-6)
    np.testing.assert_allclose(fallen, -gradient @ whole / 2.0, rtol=1e-6)


def gauss_newton_matrix(at: Callable[[Float], Problem], zero: Float) -> Float:
    """Return J'J of all residuals by differences."""

    def residuals(step: Float) -> Float:
        problem = at(step)
        error = np.zeros(ROBOT + len(problem.rest))
        prior_error(problem.prior, problem.window.pose[0], problem.rest, problem.landmarks, error)
        parts = [np.linalg.cholesky(problem.prior.information).T @ error]
        parts += [problem.window.root[i].T @ problem.window.multiplier[i] for i in (1, 2)]
        r, H = np.zeros(2), np.zeros((2, 5))
        poses = [*problem.window.pose, problem.rest[4:]]
        for owner, slot, sights, row in ((0, 0, 0, 0), (1, 1, 0, 1), (2, 0, 0, 3), (3, 1, 1, 0)):
            seen = (problem.observed, problem.kept)[sights]
            place = problem.rest[2 * slot : 2 * slot + 2]
            observation_error(seen.rows, row, poses[owner], place, r, H)
            parts.append(r.copy())
        return np.concatenate(parts)

    J = differentiate(residuals, zero, 1e-4)
    return J.T @ J
