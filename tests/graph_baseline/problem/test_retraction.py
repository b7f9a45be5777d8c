"""Both retractions of a step of the linear model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.problem.retraction import MotionNoise, retract_by_motions, retract_pointwise
from slamgauge.se2 import chain, rotation, wrap
from tests.reference.random_recordings import random_recording

Move = Callable[[Problem, MotionNoise, Float, Float, Float, Float], tuple[Float, Float]]
WAYS = [retract_pointwise, retract_by_motions]


def at_start(*, slip: bool = True) -> tuple[Problem, Float, Float]:
    """Return a problem, and path (N+1, 3) and map (L, 2) near dead reckoning."""
    problem = prepare(random_recording(5, slip=slip)[1])
    noise = 0.05 * np.random.default_rng(1).normal(size=(problem.steps, 3)) * [1.0, slip, 1.0]
    path = chain(problem.prior_mean, problem.odometry + noise)
    return problem, path, landmarks_at_median(problem, path)


def some_step(path: Float, points: Float) -> tuple[Float, Float]:
    rng = np.random.default_rng(2)
    return rng.normal(size=path.shape), rng.normal(size=points.shape)


def apart(one: Float, other: Float) -> Float:
    difference = one - other
    difference[:, 2] = wrap(difference[:, 2])
    return difference


@pytest.mark.parametrize("move", WAYS)
def test_a_small_step_is_additive(move: Move):
    problem, path, points = at_start()
    dx, dm = some_step(path, points)
    noise, h = MotionNoise(problem), 1e-5
    ahead, behind = (move(problem, noise, path, points, sign * h * dx, sign * h * dm) for sign in (1, -1))
    np.testing.assert_allclose(apart(ahead[0], behind[0]) / (2 * h), dx, atol=1e-7)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), dm, atol=1e-7)


@pytest.mark.parametrize("move", WAYS)
def test_a_step_satisfies_the_constraint_of_no_slip(move: Move):
    problem, path, points = at_start(slip=False)
    dx, dm = some_step(path, points)
    noise = MotionNoise(problem)
    moved = move(problem, noise, path, points, 0.3 * dx, 0.3 * dm)[0]
    assert np.abs(noise.residuals(moved)[1:, 1]).max() < 1e-12


def test_a_pointwise_retraction_of_a_common_rotation_keeps_all_distances():
    problem, path, points = at_start()
    centre, turn = np.array([3.0, -2.0]), 2.0
    across = np.array([[0.0, -1.0], [1.0, 0.0]])
    dx = np.column_stack([turn * (path[:, :2] - centre) @ across.T, np.full(len(path), turn)])
    moved, mapped = retract_pointwise(
        problem, MotionNoise(problem), path, points, dx, turn * (points - centre) @ across.T
    )
    turned = rotation(turn)
    np.testing.assert_allclose(moved[:, :2], centre + (path[:, :2] - centre) @ turned.T, atol=1e-12)
    np.testing.assert_allclose(mapped, centre + (points - centre) @ turned.T, atol=1e-12)


def test_a_retraction_by_motions_changes_the_residuals_linearly():
    problem, path, points = at_start()
    dx, dm = some_step(path, points)
    noise = MotionNoise(problem)
    before = noise.residuals(path)
    half, whole = (
        noise.residuals(retract_by_motions(problem, noise, path, points, share * dx, share * dm)[0])
        for share in (0.1, 0.2)
    )
    np.testing.assert_allclose(whole - before, 2.0 * (half - before), atol=1e-12)
