"""The bearing-only optimum: triangulation, placed landmarks, and the minimum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from slamgauge import load_scenario, simulate
from slamgauge.arrays import Float, Int
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, cost, robust_batch
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import SURE
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver.levenberg_marquardt import damped_descent, gauss_newton_minimum
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.triangulation import triangulate
from tests.marks import in_full
from tests.reference.least_squares import Model
from tests.reference.random_recordings import recording_of
from tests.reference.small_problems import answer, cost_of

pytestmark = pytest.mark.slow

OPTIMA = pytest.mark.parametrize("optimum", [batch, causal])


def test_exact_bearings_intersect_in_the_landmark():
    poses = np.array([[0.0, 0.0, 0.3], [1.0, -0.5, 1.0], [2.0, 0.5, -2.0]])
    landmark = np.array([3.0, 4.0])
    offset = landmark - poses[:, :2]
    bearings = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2])
    found = triangulate(poses, bearings, np.full(3, 1e-4), SURE)
    assert found.placed
    np.testing.assert_allclose(found.landmark, landmark, atol=1e-9)


def pseudolinear(poses: Float, bearings: Float, variances: Float) -> Float:
    """Return the least-squares distance from all rays: a linear estimate, biased towards the robot."""
    angle = poses[:, 2] + bearings
    across = np.column_stack([-np.sin(angle), np.cos(angle)]) / np.sqrt(variances)[:, None]
    return np.linalg.lstsq(across, (across * poses[:, :2]).sum(axis=1), rcond=None)[0]


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
    starts = [landmark, landmark / 2, pseudolinear(poses, bearings, variances), np.array([0.0, 20.0])]
    solutions = [least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-12) for start in starts]
    best = solutions[int(np.argmin([solution.cost for solution in solutions]))]
    assert sum(solution.cost < best.cost + 1e-9 for solution in solutions) >= 3
    assert 0.5 * np.square(residual(found.landmark)).sum() <= best.cost * (1 + 1e-9)
    sigmas = np.linalg.svd(np.linalg.inv(best.jac.T @ best.jac), compute_uv=False) ** 0.5
    np.testing.assert_allclose(found.landmark, best.x, rtol=0, atol=1e-4 * sigmas[0])
    assert found.sigma == pytest.approx(sigmas[0], rel=1e-3)


def test_triangulation_is_not_biased_towards_the_robot():
    """Mean of 400 errors away from the robot, in sigmas: zero within four sigmas of the mean; not so pseudolinear."""
    ours, linear = [], []
    for seed in range(400):
        poses, bearings, variances, landmark = noisy_bearings(seed)
        found = triangulate(poses, bearings, variances, SURE)
        assert found.placed
        ours.append((found.landmark - landmark)[1] / found.sigma)
        linear.append((pseudolinear(poses, bearings, variances) - landmark)[1] / found.sigma)
    assert abs(np.mean(ours)) < 0.2
    assert np.mean(linear) < -1.0


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


@OPTIMA
def test_a_landmark_with_a_single_bearing_is_ignored_and_its_association_is_minus_one(
    optimum: Callable[[Recording], Estimate],
):
    recording = recording_of("bearing", 0, steps=60, landmarks=5)
    assert recording.landmark is not None
    single = int(recording.landmark.max())
    rows = np.flatnonzero(recording.landmark == single)
    kept = np.ones(len(recording.landmark), dtype=bool)
    kept[rows[1:]] = False
    once = recording.only(kept)
    estimate = optimum(once)
    assert single not in estimate.landmark_ids
    assert once.landmark is not None
    association = np.asarray(estimate.association)
    assert (association[once.landmark == single] == -1).all()
    assert (association >= 0).sum() > len(association) / 3
    kept[rows[0]] = False
    np.testing.assert_allclose(estimate.poses, optimum(recording.only(kept)).poses, atol=1e-6)


@pytest.mark.parametrize("seed", [0, *in_full([1, 2])])
def test_the_truth_as_start_leads_to_no_lower_minimum(seed: int):
    truth, recording = simulate(load_scenario("q4-ring", ["start=sampled", "trajectory.duration=70"]), seed)
    estimate = batch(recording)
    assert truth.poses is not None
    assert truth.landmarks is not None
    problem = prepare(recording)
    ids = problem.landmark_ids
    objective = Objective(problem)
    near = damped_descent(objective, truth.poses, truth.landmarks[ids])
    poses, landmarks = gauss_newton_minimum(objective, near)[:2]
    assert cost_of(recording, answer(estimate)) <= cost(recording, poses, ids, landmarks) * (1 + 1e-6)


def test_the_last_causal_pose_is_that_of_the_hindsight_optimum():
    _, recording = simulate(load_scenario("q4-ring", ["start=sampled", "trajectory.duration=70"]), 0)
    newest, hindsight = causal(recording), batch(recording)
    assert hindsight.pose_covs is not None
    sigma = np.sqrt(np.diag(hindsight.pose_covs[-1]))
    assert (np.abs(newest.poses[-1] - hindsight.poses[-1]) < 0.2 * sigma).all()


@pytest.mark.full  # many runs
def test_causal_places_landmarks_in_short_runs():
    """Regression test: these runs failed when landmarks were added at a sigma of 0.3 of their distance."""
    scenario = load_scenario("q4-ring", ["start=sampled", "trajectory.duration=8"])
    for run in (4, 5, 18, 38):
        estimate = causal(simulate(scenario, run_seed(0, run))[1])
        assert len(np.asarray(estimate.landmark_ids)) >= 1


@pytest.mark.parametrize("optimum", [batch, causal, robust_batch])
def test_a_given_association_may_contain_landmarks_that_bearings_do_not_place(
    optimum: Callable[[Recording, Int], Estimate],
):
    recording = recording_of("bearing", 0, steps=60, landmarks=5)
    assert recording.landmark is not None
    single = int(recording.landmark.max())
    association = np.array(recording.landmark)
    association[np.flatnonzero(association == single)[1:]] = -1
    estimate = optimum(recording, association)
    assert single not in estimate.landmark_ids
    given = np.asarray(estimate.association)
    assert not (given == single).any()
    assert (given[given >= 0] == association[given >= 0]).all()
    assert (given >= 0).sum() > len(given) / 3
