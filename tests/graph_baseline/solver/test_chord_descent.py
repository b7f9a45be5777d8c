"""Accelerated chord steps: they converge to the minimum with fewer relinearisations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slamgauge import batch, causal, load_scenario, simulate
from slamgauge.compare.cli.bench import workload
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver import chord_descent, incremental
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration, largest_entry
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.incremental import SHORT, IncrementalOptimum
from slamgauge.graph_baseline.solver.search import degrees_of_freedom
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

pytestmark = pytest.mark.slow

MANY = 20  # landmarks in a scan
RATES = np.array([0.98, 0.7, -1.3, 0.1])  # ratios of consecutive steps along four axes; the third diverges


def test_acceleration_of_a_linear_iteration_converges_after_as_many_steps_as_unknowns() -> None:
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    weight, end, x = np.array([1.0, 10.0, 0.1, 3.0]), rng.normal(size=4), np.zeros(4)
    acceleration = AndersonAcceleration()
    for _ in range(6):
        step = axes @ ((1.0 - RATES) * (axes.T @ (end - x)))
        move = acceleration.accelerate(step, weight * step)
        x = x + move
        acceleration.record(move)
    assert largest_entry(weight * (x - end)) < 1e-9


def test_acceleration_reduces_relinearisations_of_a_large_map(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = simulate(workload(100), 0)[1].first(200)
    count, relinearise = [0], ChordDescent.relinearise

    def counted(descent: ChordDescent) -> bool:
        count[0] += 1
        return relinearise(descent)

    monkeypatch.setattr(ChordDescent, "relinearise", counted)
    counts: list[int] = []
    optimum = batch(recording)
    assert optimum.pose_covs is not None
    sigma = np.sqrt(np.diag(optimum.pose_covs[-1]))
    for large in (10_000, 20):
        monkeypatch.setattr(chord_descent, "LARGE", large)
        count[0], estimator = 0, IncrementalOptimum(recording)
        for _ in range(recording.steps + 1):
            estimator.add_step()
        counts.append(count[0])
        assert estimator.converged
        assert (np.abs(estimator.newest_pose() - optimum.poses[-1]) < 0.02 * sigma).all()
    assert counts[1] < 0.7 * counts[0], counts


def test_a_short_recording_with_one_minimum_has_no_changes_and_the_degrees_of_freedom_of_its_problem() -> None:
    recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 0)[1].first(SHORT)
    estimator = IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        estimator.add_step()
    estimator.finish()
    assert estimator.changes == []
    assert estimator._degrees_of_freedom() == degrees_of_freedom(prepare(recording))


def test_the_error_between_two_convergences_is_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound is for the mean over steps; with ten times MAX_ERROR the mean would be 0.006."""
    recording = simulate(load_scenario("q1-long-dense", ["start=sampled"]), 0)[1].first(600)
    found = causal(recording)
    monkeypatch.setattr(incremental, "MAX_ERROR", 0.0)  # converges at every scan
    exact = causal(recording)
    assert exact.pose_covs is not None
    apart = found.poses - exact.poses
    apart[:, 2] = wrap(apart[:, 2])
    sigmas = np.sqrt(np.diagonal(exact.pose_covs, axis1=1, axis2=2))
    assert np.abs(apart / sigmas).max(axis=1)[SHORT:].mean() < 0.004


@pytest.mark.parametrize("twice", [False, True])
def test_scans_of_many_landmarks_give_the_covariances_of_the_hindsight_optimum(twice: bool) -> None:
    """A scan may observe a landmark `twice`."""
    recording = simulate(workload(100), 0)[1].first(40)
    assert np.bincount(recording.observation_step).min() > MANY
    if twice:
        names = ("observation_step", "observation", "observation_cov", "landmark")
        doubled: dict[str, Any] = {name: np.repeat(getattr(recording, name), 2, axis=0) for name in names}
        recording = replace(recording, **doubled)
    estimator = IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        estimator.add_step()
    estimator.finish()
    optimum = batch(recording)
    assert optimum.pose_covs is not None and optimum.landmark_covs is not None
    np.testing.assert_allclose(estimator.newest_cov(), optimum.pose_covs[-1], rtol=1e-5, atol=1e-12)
    order = np.argsort(estimator.landmark_ids)
    np.testing.assert_allclose(estimator.landmark_covs()[order], optimum.landmark_covs, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize(("smallest", "prior_sigma"), [(1e-7, 1.0), (1.0, 1e4)])
def test_scans_of_many_landmarks_lose_no_digits(smallest: float, prior_sigma: float) -> None:
    """The covariance of a landmark that is observed once is the sum of those of pose and observation."""
    count = MANY + 1
    rng = np.random.default_rng(0)
    landmarks_at = rng.uniform(-5.0, 5.0, (count, 2))
    sigmas = np.append(smallest, np.ones(count - 1))
    recording = Recording(
        stamps=np.zeros(1),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([prior_sigma, prior_sigma, 0.1]) ** 2,
        odometry=np.zeros((0, 3)),
        odometry_cov=np.zeros((0, 3, 3)),
        sensor="position",
        observation_step=np.zeros(count, dtype=np.int64),
        observation=landmarks_at,
        observation_cov=np.square(sigmas)[:, None, None] * np.eye(2),
        landmark=np.arange(count),
    )
    estimator = IncrementalOptimum(recording)
    estimator.add_step()
    lever = np.column_stack([-landmarks_at[:, 1], landmarks_at[:, 0]])
    expected = (prior_sigma**2 + np.square(sigmas))[:, None, None] * np.eye(2)
    expected = expected + 0.01 * lever[:, :, None] * lever[:, None, :]
    np.testing.assert_allclose(estimator.landmark_covs(), expected, rtol=0, atol=1e-6 * prior_sigma**2)


def test_a_chord_step_is_measured_by_the_change_of_all_predicted_observations() -> None:
    recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 0)[1].first(30)
    estimator = IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        estimator.add_step()
    descent = estimator._descent
    model, step, seen_from = descent._model, descent._step, recording.observation_step
    descent._state.landmarks[:] += np.random.default_rng(0).normal(size=descent._state.landmarks.shape) / 100
    size = descent._chord_step()
    change = np.einsum("mij,mj->mi", model.Hx, step.pose[seen_from])
    change += np.einsum("mij,mj->mi", model.Hm, step.landmark[descent._scans.slot])
    np.testing.assert_allclose(step.seen, change, rtol=0, atol=1e-9)
    assert size == pytest.approx(np.linalg.norm(change))
