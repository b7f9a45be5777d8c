"""Chord steps that are mixed: they lead to the minimum, with fewer matrices than steps alone need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import batch, causal, load_scenario, simulate
from slamgauge.compare.bench.step_times import workload
from slamgauge.graph_baseline.solver import chord_descent, incremental
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration, largest_entry
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.incremental import SHORT, IncrementalOptimum
from slamgauge.graph_baseline.solver.pose_elimination import MANY
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

RATES = np.array([0.98, 0.7, -1.3, 0.1])  # of a step is left for the next; one swings ever wider


def test_mixed_steps_of_a_linear_map_end_after_as_many_as_it_has_rates() -> None:
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    weight, end, x, mixing = np.array([1.0, 10.0, 0.1, 3.0]), rng.normal(size=4), np.zeros(4), AndersonAcceleration()
    for _ in range(6):
        step = turn @ ((1.0 - RATES) * (turn.T @ (end - x)))
        move = mixing.accelerate(step, weight * step)
        x = x + move
        mixing.record(move)
    assert largest_entry(weight * (x - end)) < 1e-9


def test_mixing_spares_a_large_map_linearisations(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = simulate(workload(100), 0)[1].first(200)
    anew, relinearise = [0], ChordDescent.relinearise

    def counted(descent: ChordDescent) -> bool:
        anew[0] += 1
        return relinearise(descent)

    monkeypatch.setattr(ChordDescent, "relinearise", counted)
    taken: list[int] = []
    optimum = batch(recording)
    assert optimum.pose_covs is not None
    sigma = np.sqrt(np.diag(optimum.pose_covs[-1]))
    for large in (10_000, 20):
        monkeypatch.setattr(chord_descent, "LARGE", large)
        anew[0], growing = 0, IncrementalOptimum(recording)
        for _ in range(recording.steps + 1):
            growing.add_step()
        taken.append(anew[0])
        assert growing.converged
        assert (np.abs(growing.newest_pose() - optimum.poses[-1]) < 0.02 * sigma).all()
    assert taken[1] < 0.7 * taken[0], taken


def test_little_is_missed_between_settlings(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the mean over steps; ten times the miss that is allowed would take it to .006."""
    recording = simulate(load_scenario("q1-long-dense", ["start=sampled"]), 0)[1].first(600)
    found = causal(recording)
    monkeypatch.setattr(incremental, "MAX_ERROR", 0.0)  # settles at every scan
    exact = causal(recording)
    assert exact.pose_covs is not None
    apart = found.poses - exact.poses
    apart[:, 2] = wrap(apart[:, 2])
    sigmas = np.sqrt(np.diagonal(exact.pose_covs, axis1=1, axis2=2))
    assert np.abs(apart / sigmas).max(axis=1)[SHORT:].mean() < 0.004


@pytest.mark.parametrize("twice", [False, True])
def test_scans_of_many_landmarks_leave_what_they_leave_in_hindsight(twice: bool) -> None:
    """At its end the causal optimum knows the same of pose and map; a landmark may be seen twice."""
    recording = simulate(workload(100), 0)[1].first(40)
    assert np.bincount(recording.observation_step).min() > MANY
    if twice:
        recording = replace(
            recording,
            **{
                name: np.repeat(getattr(recording, name), 2, axis=0)
                for name in ("observation_step", "observation", "observation_cov", "landmark")
            },
        )
    growing = IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        growing.add_step()
    growing.finish()
    optimum = batch(recording)
    assert optimum.pose_covs is not None and optimum.landmark_covs is not None
    np.testing.assert_allclose(growing.newest_cov(), optimum.pose_covs[-1], rtol=1e-5, atol=1e-12)
    order = np.argsort(growing.landmark_ids)
    np.testing.assert_allclose(growing.landmark_covs()[order], optimum.landmark_covs, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize(("sharp", "doubt"), [(1e-7, 1.0), (1.0, 1e4)])
def test_scans_of_many_landmarks_keep_their_digits(sharp: float, doubt: float) -> None:
    """What is seen once, from one pose, is known by that sight and by how far the pose is doubted."""
    sights = MANY + 1
    rng = np.random.default_rng(0)
    landmarks_at = rng.uniform(-5.0, 5.0, (sights, 2))
    sigmas = np.append(sharp, np.ones(sights - 1))
    recording = Recording(
        stamps=np.zeros(1),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([doubt, doubt, 0.1]) ** 2,
        odometry=np.zeros((0, 3)),
        odometry_cov=np.zeros((0, 3, 3)),
        sensor="position",
        observation_step=np.zeros(sights, dtype=np.int64),
        observation=landmarks_at,
        observation_cov=np.square(sigmas)[:, None, None] * np.eye(2),
        landmark=np.arange(sights),
    )
    growing = IncrementalOptimum(recording)
    growing.add_step()
    lever = np.column_stack([-landmarks_at[:, 1], landmarks_at[:, 0]])
    expected = (doubt**2 + np.square(sigmas))[:, None, None] * np.eye(2)
    expected = expected + 0.01 * lever[:, :, None] * lever[:, None, :]
    np.testing.assert_allclose(growing.landmark_covs(), expected, rtol=0, atol=1e-6 * doubt**2)
