"""Recordings without a well-determined optimum: an error with a remedy, or the right result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from slamgauge import load_scenario, simulate
from slamgauge.ekf import dead_reckoning
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, batch, causal
from slamgauge.graph_baseline.gtsam_batch import REGULARISING_NOISE
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.graph_baseline.solver import incremental
from slamgauge.recording import Recording
from slamgauge.se2 import between
from tests.reference.least_squares import Model
from tests.reference.random_recordings import random_recording
from tests.reference.small_problems import (
    answer,
    assert_same_covariances,
    one_observation_at_start,
    pose_difference,
    problem,
)

pytestmark = pytest.mark.slow

Estimator = Callable[[Recording], Estimate]

OPTIMA = pytest.mark.parametrize("estimator", [batch, causal])


def one_vague_observation(bearing_variance: float) -> Recording:
    """Return a recording with a single observation of landmark 5, at about 3 m, with a huge bearing variance."""
    _, recording = random_recording(0, steps=10, landmarks=3)
    assert recording.landmark is not None
    row = int(np.flatnonzero(recording.landmark == 5)[3])
    covs = recording.observation_cov.copy()
    covs[row] = np.diag([0.01, bearing_variance])
    kept = (recording.landmark != 5) | (np.arange(len(recording.landmark)) == row)
    return replace(recording, observation_cov=covs).only(kept)


@pytest.mark.parametrize(
    ("key", "start", "remedy"), [(L(5), "landmark 5: ", "add observations"), (X(7), "pose 7: ", "smaller variances")]
)
def test_an_error_of_gtsam_is_converted_to_one_line_with_variable_and_remedy(key: int, start: str, remedy: str) -> None:
    """The graph contains only the distance of a variable from the origin."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(X(0), gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
    values.insert(X(0), gtsam.Pose2())
    distance = gtsam.noiseModel.Isotropic.Sigma(1, 0.1)
    if key == L(5):
        graph.add(gtsam.RangeFactor2D(X(0), key, 2.0, distance))
        values.insert(key, np.array([2.0, 1.0]))
    else:
        graph.add(gtsam.RangeFactorPose2(X(0), key, 2.0, distance))
        values.insert(key, gtsam.Pose2(2.0, 1.0, 0.0))
    with pytest.raises(UndeterminedError) as caught, explained():
        gtsam.GaussNewtonOptimizer(graph, values).optimize()
    message = str(caught.value)
    assert message.startswith(start)
    assert remedy in message
    assert "\n" not in message
    assert isinstance(caught.value, ValueError)


def relative_sigma_error(estimator: Estimator, bearing_variance: float) -> float:
    """Return the relative error of the landmark's sigma, given its only observation; 0 if the estimator raises."""
    recording = one_vague_observation(bearing_variance)
    try:
        found = answer(estimator(recording))
    except UndeterminedError:
        return 0.0
    distance = recording.observation[list(recording.landmark if recording.landmark is not None else []).index(5), 0]
    cov = found.landmark_covs[found.ids.tolist().index(5)]
    return abs(math.sqrt(float(np.trace(cov)) / bearing_variance) / distance - 1)


@OPTIMA
@pytest.mark.parametrize("bearing_variance", [1e2, 1e6, 1e10])
def test_a_vague_landmark_has_the_covariance_of_its_observation(estimator: Estimator, bearing_variance: float) -> None:
    assert relative_sigma_error(estimator, bearing_variance) < 0.01


def test_ranges_from_several_places_determine_a_landmark() -> None:
    recording = problem(0, "range-bearing", True)[1]
    assert recording.landmark is not None
    covs = recording.observation_cov.copy()
    covs[recording.landmark == 5] = np.diag([0.01, 1e20])
    ranges_only = replace(recording, observation_cov=covs)
    reference = Model(ranges_only)
    minimum = reference.minimum(reference.drawn_start(np.zeros(reference.noises)))
    expected = reference.covariances(minimum.unknowns)[1]
    assert expected.max() < 0.2
    assert_same_covariances(answer(batch(ranges_only)).landmark_covs, expected, 1e-6)


@pytest.mark.parametrize(("estimator", "tolerance"), [(batch, 1e-9), (causal, (REGULARISING_NOISE * 0.1) ** 2)])
def test_the_prior_may_be_singular(estimator: Estimator, tolerance: float) -> None:
    prior_cov = np.diag([0.01, 0.0, 1e-4])
    recording = one_observation_at_start(prior_mean=[0.3, -0.2, 0.4], prior_cov=prior_cov)
    np.testing.assert_allclose(answer(estimator(recording)).pose_covs[0], prior_cov, atol=tolerance)


@pytest.mark.parametrize(("estimator", "tolerance"), [(batch, 1e-6), (causal, 0.1)])
def test_motion_noise_may_be_singular_in_any_direction(estimator: Estimator, tolerance: float) -> None:
    """The result is the limit of a vanishing variance; the tolerance is in standard deviations."""
    recording = problem(0, "range-bearing", True)[1]
    leaning = np.outer([0.03, 0.02, 0.01], [0.03, 0.02, 0.01]) + np.diag([0.0, 0.0, 1e-4])
    singular = replace(recording, odometry_cov=np.tile(leaning, (recording.steps, 1, 1)))
    nearly = replace(singular, odometry_cov=singular.odometry_cov + 1e-14 * np.eye(3))
    limit, actual = answer(batch(nearly)), answer(estimator(singular))
    assert np.abs(pose_difference(actual.poses, limit)[-1]).max() < tolerance


@OPTIMA
def test_beyond_double_precision_the_estimator_raises_or_is_right(estimator: Estimator) -> None:
    assert max(relative_sigma_error(estimator, 10.0**power) for power in range(11, 31)) < 0.1


@OPTIMA
def test_without_observations_the_optimum_is_dead_reckoning(estimator: Estimator) -> None:
    recording = problem(0, "range-bearing", True)[1]
    empty = recording.only(np.zeros(len(recording.observation), dtype=bool))
    np.testing.assert_allclose(between(dead_reckoning(empty).poses, answer(estimator(empty)).poses), 0.0, atol=1e-9)


@pytest.mark.parametrize("observed", [(0,), (1,), (0, 3), (4,)])
def test_causal_accepts_few_observations_with_long_gaps(observed: tuple[int, ...]) -> None:
    recording = problem(0, "range-bearing", True)[1]
    sparse = recording.only(np.isin(recording.observation_step, observed) & (prepare(recording).landmark == 0))
    last = answer(batch(sparse))
    off = between(last.poses, answer(causal(sparse)).poses)[-1]
    assert (np.abs(off) < 0.02 * np.sqrt(np.diag(last.pose_covs[-1]))).all()


def test_a_landmark_at_the_robots_position_is_named() -> None:
    rng = np.random.default_rng(0)
    steps = np.arange(11)
    observation = np.column_stack([np.abs(5.0 - steps), np.where(steps < 5, 0.0, np.pi)])
    observation += rng.normal(0.0, [0.1, 0.05], (11, 2))
    observation[5] = 1e-3, 2.0
    through = Recording(
        sensor="range-bearing",
        stamps=steps.astype(np.float64),
        odometry=np.tile([1.0, 0.0, 0.0], (10, 1)),
        odometry_cov=np.tile(np.diag([0.01, 0.01, 0.001]), (10, 1, 1)),
        observation_step=steps,
        observation=observation,
        observation_cov=np.tile(np.diag([0.01, 0.0025]), (11, 1, 1)),
        landmark=np.full(11, 7),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([0.01, 0.01, 0.001]),
    )
    with pytest.raises(
        UndeterminedError, match=r"^batch: no minimum, landmark 7 moves to .* m from pose 5 that observes it"
    ):
        batch(through)


def test_large_odometry_noise_needs_few_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chord steps diverge at most poses; damped steps replace searches, and the last pose is still the optimum's."""
    monkeypatch.setattr(incremental, "SHORT", 10)
    _, recording = simulate(load_scenario("q1-short-dense", ["motion.sigma_speed=100", "trajectory.duration=4"]), 3)
    optimum = incremental.IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        optimum.add_step()
    optimum.finish()
    assert len(optimum.changes) <= 5
    np.testing.assert_allclose(optimum.newest_pose(), batch(recording).poses[-1], atol=1e-3)
