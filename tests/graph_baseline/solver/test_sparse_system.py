"""The sparse factorisation of large maps gives the step and the covariances of the dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver import smoother
from slamgauge.graph_baseline.solver.smoother import NOT_DAMPED, Damping, damped_step, is_sparse, solve
from slamgauge.recording import Recording
from tests.reference.random_recordings import random_recording, recording_of
from tests.reference.small_problems import answer, assert_same_covariances, pose_difference, sigmas_of

SAME = 1e-6  # standard deviations
DAMPED = Damping(np.array([30.0, 30.0, 200.0]), 50.0, 0.2)


def large_map(prior: float) -> Recording:
    """Return 579 landmarks in 5 poses, with a prior of given standard deviation [m]."""
    return random_recording(1, steps=4, landmarks=600, slip=False, prior_sigmas=(prior, prior, 0.2 * prior))[1]


@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
@pytest.mark.parametrize("slip", [True, False])
def test_steps_and_covariances_are_those_of_dense_matrices(
    sensor: str, slip: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = prepare(recording_of(sensor, 3, slip=slip))
    objective = Objective(problem)
    point = objective.at(problem.dead_reckoning, landmarks_at_median(problem, problem.dead_reckoning))
    system = point.model, objective.scans, len(point.landmarks)
    dense, steps = solve(*system), [damped_step(*system, damping) for damping in (NOT_DAMPED, DAMPED)]
    monkeypatch.setattr(smoother, "is_sparse", lambda *_: True)
    sparse = solve(*system)
    pose_sigmas, landmark_sigmas = sigmas_of(dense.pose_covs), sigmas_of(dense.landmark_covs)
    for (dx, dm), damping in zip(steps, (NOT_DAMPED, DAMPED), strict=True):
        ours = damped_step(*system, damping)
        np.testing.assert_allclose(ours[0] / pose_sigmas, dx / pose_sigmas, rtol=0, atol=SAME)
        np.testing.assert_allclose(ours[1] / landmark_sigmas, dm / landmark_sigmas, rtol=0, atol=SAME)
    np.testing.assert_array_equal(sparse.dx, damped_step(*system, NOT_DAMPED)[0])
    assert_same_covariances(sparse.pose_covs, dense.pose_covs, SAME)
    assert_same_covariances(sparse.landmark_covs, dense.landmark_covs, SAME)
    assert np.abs(steps[0][0] - steps[1][0]).max() > 1e-3  # the damping matters


@pytest.mark.parametrize("prior", [0.1, 0.0], ids=["prior", "fixed"])
def test_batch_of_a_large_map_is_the_optimum_of_dense_matrices(prior: float, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = large_map(prior)
    assert is_sparse(recording.steps + 1, len(recording.observation), 579)
    sparse = answer(batch(recording))
    monkeypatch.setattr(smoother, "LARGEST_DENSE", 600)
    dense = answer(batch(recording))
    np.testing.assert_array_equal(sparse.ids, dense.ids)
    np.testing.assert_allclose(pose_difference(sparse.poses, dense), 0.0, atol=SAME)
    np.testing.assert_allclose((sparse.landmarks - dense.landmarks) / sigmas_of(dense.landmark_covs), 0.0, atol=SAME)
    assert_same_covariances(sparse.pose_covs, dense.pose_covs, SAME)
    assert_same_covariances(sparse.landmark_covs, dense.landmark_covs, SAME)


def test_a_large_map_needs_no_dense_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 1e4)
    assert len(batch(large_map(0.1)).landmarks) == 579
