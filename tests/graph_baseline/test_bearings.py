"""The bearing-only optimum: triangulation, placed landmarks, and the minimum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from slamgauge import load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, robust_batch
from slamgauge.graph_baseline.problem.placement import SURE, are_placed, landmarks_at_median, triangulate_all
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum
from slamgauge.graph_baseline.solver.search import placed_minimum
from slamgauge.se2 import wrap
from slamgauge.triangulation import triangulate
from tests.reference.least_squares import Model
from tests.reference.random_recordings import recording_of
from tests.reference.small_problems import answer, cost_of

pytestmark = pytest.mark.slow

OPTIMA = pytest.mark.parametrize("optimum", [batch, causal])


def noisy_bearings(seed: int) -> tuple[Float, Float, Float, Float]:
    """Return poses, bearings, variances and landmark: 8 m beside a winding path of 5 m, noise about 3 degrees."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 5.0, 30)
    poses = np.column_stack([x, 0.3 * np.sin(x), rng.uniform(-np.pi, np.pi, 30)])
    landmark, variances = np.array([3.0, 8.0]), np.deg2rad(rng.uniform(1.5, 4.5, 30)) ** 2
    offset = landmark - poses[:, :2]
    exact = np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2]
    return poses, wrap(exact + np.sqrt(variances) * rng.normal(size=30)), variances, landmark


@pytest.mark.parametrize("seed", range(10))
def test_triangulation_minimises_the_squared_residuals_of_bearings(seed: int):
    """The minimum and its sigma are those that scipy finds from several starts."""
    poses, bearings, variances, landmark = noisy_bearings(seed)

    def residual(at: Float) -> Float:
        offset = at - poses[:, :2]
        return wrap(bearings + poses[:, 2] - np.arctan2(offset[:, 1], offset[:, 0])) / np.sqrt(variances)

    found = triangulate(poses, bearings, variances, SURE)
    assert found.placed
    starts = [landmark, landmark / 2, np.array([1.0, 3.0]), np.array([0.0, 20.0])]
    solutions = [least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-12) for start in starts]
    best = solutions[int(np.argmin([solution.cost for solution in solutions]))]
    assert sum(solution.cost < best.cost + 1e-9 for solution in solutions) >= 3
    assert 0.5 * np.square(residual(found.landmark)).sum() <= best.cost * (1 + 1e-9)
    sigmas = np.linalg.svd(np.linalg.inv(best.jac.T @ best.jac), compute_uv=False) ** 0.5
    np.testing.assert_allclose(found.landmark, best.x, rtol=0, atol=1e-4 * sigmas[0])
    assert found.sigma == pytest.approx(sigmas[0], rel=1e-3)


@pytest.mark.parametrize(
    ("poses", "bearings"),
    [
        (np.zeros((1, 3)), np.zeros(1)),  # a single bearing
        (np.zeros((5, 3)), np.zeros(5)),  # no motion
        (np.array([[0.0, 0, 0], [1, 0, 0]]), np.zeros(2)),  # motion towards the landmark
        (np.array([[0.0, 0, 0], [0, 0.01, 0]]), np.array([0.0, 0.0])),  # parallel rays
        (np.array([[0.0, 0, 0], [0, 1, 0]]), np.array([0.1, -0.1]) + np.pi),  # rays that intersect behind the robot
    ],
)
def test_bearings_without_a_usable_intersection_place_no_landmark(poses: Float, bearings: Float):
    assert not triangulate(poses, bearings, np.full(len(poses), np.deg2rad(5.0) ** 2), SURE).placed


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_minimum_is_that_of_dense_least_squares(seed: int):
    recording = recording_of("bearing", seed, steps=25, landmarks=4)
    estimate = batch(recording)
    assert estimate.association is not None and estimate.pose_covs is not None
    model = Model(recording.associated(estimate.association))
    start = model.unknowns(model.relative(estimate.poses), model.relative(answer(estimate).landmarks))
    nearby = start + 1e-2 * np.random.default_rng(seed).normal(size=len(start))
    minimum = model.minimum(nearby)
    assert np.abs(minimum.unknowns - start)[: model.noises].max() < 1e-5
    np.testing.assert_allclose(estimate.pose_covs, model.covariances(minimum.unknowns)[0], rtol=1e-4, atol=1e-12)
    assert cost_of(model.recording, answer(estimate)) == pytest.approx(minimum.cost, rel=1e-6)


def test_the_last_causal_pose_is_that_of_the_hindsight_optimum():
    _, recording = simulate(load_scenario("q4-ring", ["start=sampled", "trajectory.duration=70"]), 0)
    newest, hindsight = causal(recording), batch(recording)
    assert hindsight.pose_covs is not None
    sigma = np.sqrt(np.diag(hindsight.pose_covs[-1]))
    assert (np.abs(newest.poses[-1] - hindsight.poses[-1]) < 0.2 * sigma).all()


@pytest.mark.parametrize("optimum", [batch, causal, robust_batch])
@pytest.mark.parametrize("given", [True, False])
def test_a_landmark_with_a_single_bearing_is_ignored_and_its_association_is_minus_one(
    optimum: Callable[..., Estimate], given: bool
):
    """The ids are those of the recording, or a `given` association."""
    recording = recording_of("bearing", 0, steps=60, landmarks=5)
    assert recording.landmark is not None
    single = int(recording.landmark.max())
    rows = np.flatnonzero(recording.landmark == single)
    association = np.array(recording.landmark)
    association[rows[1:]] = -1
    estimate = optimum(recording, association) if given else optimum(recording.associated(association))
    assert single not in estimate.landmark_ids
    used = np.asarray(estimate.association)
    assert not (used == single).any()
    association[rows[0]] = -1
    expected = optimum(recording.associated(association))
    np.testing.assert_allclose(estimate.poses, expected.poses, atol=1e-6)
    assert (used >= 0).sum() == (np.asarray(expected.association) >= 0).sum() > len(used) / 3


@pytest.mark.parametrize("seed", [3, 9])
def test_the_causal_map_has_no_landmark_that_its_bearings_no_longer_place(seed: int):
    """In both recordings a later minimum moves the path so that a landmark with a small sigma loses its position."""
    recording = recording_of("bearing", seed, steps=60, landmarks=5)
    problem, estimator = prepare(recording), IncrementalOptimum(recording)
    for k in range(recording.steps + 1):
        estimator.add_step()
        ids, _, sigmas = triangulate_all(problem.first(k), estimator.path_and_map()[0])
        assert np.isin(estimator.landmark_ids, ids[np.isfinite(sigmas)]).all()


@pytest.mark.parametrize(("seed", "steps", "landmarks"), [(3, 40, 8), (36, 25, 4)])
def test_a_search_adds_landmarks_that_its_minimum_places_and_dead_reckoning_does_not(
    seed: int, steps: int, landmarks: int
):
    problem = prepare(recording_of("bearing", seed, steps=steps, landmarks=landmarks))
    path = problem.dead_reckoning
    taken, found = placed_minimum(problem, path, lambda part, path: [lambda: (path, landmarks_at_median(part, path))])
    np.testing.assert_array_equal(taken >= 0, are_placed(problem, found.poses))
    assert (taken >= 0).sum() > are_placed(problem, path).sum()
