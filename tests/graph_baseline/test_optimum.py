"""The optimum compared with independent solutions: dense least squares, and other estimates.

Residuals are those of GTSAM: Log(measured^-1 between) with the covariances of the recording. Differences are in
standard deviations of the optimum. Problems are small and seeds fixed, so that all numbers are reproducible.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int
from slamgauge.ekf import dead_reckoning, ekf_slam
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, cost
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.recording import Recording
from slamgauge.se2 import compose
from tests.reference.given import given
from tests.reference.least_squares import Model
from tests.reference.small_problems import (
    Answer,
    answer,
    assert_same_covariances,
    cost_of,
    one_observation_at_start,
    optimum,
    pose_difference,
    problem,
    sigmas_of,
)

pytestmark = pytest.mark.slow

Estimator = Callable[[Recording], Estimate]
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
SLIP = pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
SEEDS = pytest.mark.parametrize("seed", range(3))
OPTIMA = pytest.mark.parametrize("estimator", [batch, causal])


@pytest.mark.parametrize("sigmas", [0.0, 0.3])
def test_the_check_of_causal_is_the_distance_from_the_optimum_in_sigmas(
    sigmas: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = import_module("slamgauge.graph_baseline.causal")
    optimum_from = module.optimum_from

    def shifted(*arguments: Any) -> Estimate:
        found = optimum_from(*arguments)
        sigma = np.sqrt(np.diagonal(given(found.pose_covs), axis1=1, axis2=2))
        return replace(found, poses=found.poses + sigmas * sigma)

    monkeypatch.setattr(module, "optimum_from", shifted)
    assert causal(problem(0, "range-bearing", True)[1]).optimum_check == pytest.approx(sigmas, abs=0.02)


# --- dense least squares ---------------------------------------------------------------------------


@SEEDS
@SENSORS
@SLIP
@pytest.mark.parametrize("fixed", [False, True], ids=["prior", "fixed"])
def test_batch_is_the_minimum_that_dense_least_squares_finds(seed: int, sensor: str, slip: bool, fixed: bool) -> None:
    """Measured: cost equal to 1e-14, poses within 1e-7 sigma, covariances within 4e-8."""
    recording = problem(seed, sensor, slip, fixed)[1]
    reference = Model(recording)
    unknowns = reference.minimum(reference.drawn_start(np.zeros(reference.noises))).unknowns
    found = optimum(seed, sensor, slip, fixed)
    pose_covs, landmark_covs = reference.covariances(unknowns)
    poses, landmarks = reference.world(reference.poses(unknowns)), reference.world(reference.landmarks(unknowns))
    expected = Answer(poses, pose_covs, reference.ids, landmarks, landmark_covs)
    np.testing.assert_array_equal(found.ids, expected.ids)
    np.testing.assert_allclose(cost_of(recording, found), reference.cost(unknowns), rtol=1e-12)
    np.testing.assert_allclose(pose_difference(found.poses, expected), 0.0, atol=1e-6)
    np.testing.assert_allclose((found.landmarks - expected.landmarks) / sigmas_of(landmark_covs), 0.0, atol=1e-6)
    assert_same_covariances(found.pose_covs, pose_covs, 1e-6)
    assert_same_covariances(found.landmark_covs, landmark_covs, 1e-6)


@SEEDS
@SENSORS
def test_cost_is_that_of_the_reference_and_of_gtsam_at_any_path_and_map(seed: int, sensor: str) -> None:
    (truth, recording), found = problem(seed, sensor, True), optimum(seed, sensor, True)
    assert truth.poses is not None
    rng, reference = np.random.default_rng(seed), Model(recording)
    turned = compose(truth.poses, rng.uniform(-1, 1, truth.poses.shape) * [1, 1, 3])
    for poses in (found.poses, truth.poses, turned):
        landmarks = found.landmarks + rng.normal(size=found.landmarks.shape)
        ours = cost(recording, poses, found.ids, landmarks)
        unknowns = reference.unknowns(reference.relative(poses), reference.relative(landmarks))
        assert ours == pytest.approx(reference.cost(unknowns), rel=1e-10)
        assert cost(recording, poses, found.ids[::-1], landmarks[::-1]) == pytest.approx(ours, rel=1e-13)
        if sensor == "range-bearing":
            assert ours == pytest.approx(gtsam_error(recording, poses, found.ids, landmarks), rel=1e-10)


def gtsam_error(recording: Recording, poses: Float, ids: Int, landmarks: Float) -> float:
    """Return GTSAM's cost with the factors of `gtsam_batch`."""
    graph, values, problem = gtsam.NonlinearFactorGraph(), gtsam.Values(), prepare(recording)
    for factor in [*motion_factors(problem), *observation_factors(problem)]:
        graph.add(factor)
    for k, pose in enumerate(poses.tolist()):
        values.insert(X(k), gtsam.Pose2(*pose))
    for name, landmark in zip(ids.tolist(), landmarks, strict=True):
        values.insert(L(name), landmark)
    return graph.error(values)


# --- a minimum -----------------------------------------------------------------------------------


def cost_by_odometry(recording: Recording) -> float:
    """Return the cost of dead reckoning, with every landmark at its first observation."""
    reference, path = Model(recording), dead_reckoning(recording).poses
    landmarks = reference.sighted(reference.relative(path))
    return cost(recording, path, reference.ids, reference.world(landmarks))


@SENSORS
def test_a_motion_that_violates_a_constraint_has_infinite_cost(sensor: str) -> None:
    """Optimum and dead reckoning satisfy a zero lateral variance; the corrections of filters do not."""
    recording, found = problem(0, sensor, False)[1], optimum(0, sensor, False)
    assert cost_of(recording, found) < cost_by_odometry(recording) < math.inf
    assert cost_of(recording, answer(ekf_slam(recording))) == math.inf
    sideways = compose(found.poses, np.array([[0.0, 2e-6, 0.0]] * 13 + [[0.0, 0.0, 0.0]] * 13))
    assert cost(recording, sideways, found.ids, found.landmarks) == math.inf


@OPTIMA
def test_the_priors_covariance_is_in_the_world_frame(estimator: Estimator) -> None:
    """The first observation of a landmark has no information about the pose, so the result is the prior."""
    prior_cov = np.array([[1.0, 0.02, 0.05], [0.02, 0.01, 0.0], [0.05, 0.0, 0.01]])
    recording = one_observation_at_start(prior_mean=[0.0, 0.0, math.pi / 2], prior_cov=prior_cov)
    np.testing.assert_allclose(answer(ekf_slam(recording)).pose_covs[0], prior_cov, atol=1e-12)
    np.testing.assert_allclose(answer(estimator(recording)).pose_covs[0], prior_cov, atol=1e-9)


# --- the causal optimum --------------------------------------------------------------------------


@SENSORS
@SLIP
def test_causal_uses_no_measurement_of_the_future(sensor: str, slip: bool) -> None:
    recording = problem(1, sensor, slip)[1]
    whole, until = answer(causal(recording)), 14
    cut = answer(causal(recording.first(until)))
    np.testing.assert_array_equal(cut.poses, whole.poses[: until + 1])
    np.testing.assert_array_equal(cut.pose_covs, whole.pose_covs[: until + 1])


@SENSORS
@SLIP
@SEEDS
def test_causal_is_near_the_optimum_of_the_measurements_so_far(seed: int, sensor: str, slip: bool) -> None:
    recording = problem(seed, sensor, slip)[1]
    incremental = causal(recording).poses
    for k in range(1, 26, 4):
        so_far = answer(batch(recording.first(k)))
        assert np.abs(pose_difference(incremental[: k + 1], so_far)[-1]).max() < 0.005
