"""The compressed filter equals the full one; only the account of the rest of the map differs."""

from __future__ import annotations

import numpy as np
import pytest
from random_recordings import random_recording

from slamgauge.compare.bench.bench import workload
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import CompressedFilter, SlamFilter
from slamgauge.recording import Observations, Recording


def assert_equal_all_along(recording: Recording, area_radius: float) -> int:
    """Compare pose and covariance at every step, the whole map every 50 steps; returns how often an area was left."""
    prior = recording.sensor, recording.prior_mean, recording.prior_cov
    full, compressed = SlamFilter(*prior), CompressedFilter(*prior, area_radius)
    areas = {id(compressed._local): compressed._local}  # pyright: ignore[reportPrivateUsage]
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            full.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            compressed.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        assert compressed.update(scan) == pytest.approx(full.update(scan))
        areas[id(compressed._local)] = compressed._local  # pyright: ignore[reportPrivateUsage]
        np.testing.assert_allclose(compressed.pose, full.pose, rtol=0, atol=1e-9)
        np.testing.assert_allclose(compressed.pose_cov, full.pose_cov, rtol=1e-9, atol=1e-12)
        if k % 50 == 0 or k == recording.steps:
            assert set(compressed.landmark_ids) == set(full.landmark_ids)
            ours, theirs = np.argsort(compressed.landmark_ids), np.argsort(full.landmark_ids)
            np.testing.assert_allclose(compressed.landmarks[ours], full.landmarks[theirs], rtol=0, atol=1e-9)
            np.testing.assert_allclose(sorted_cov(compressed, ours), sorted_cov(full, theirs), rtol=0, atol=1e-9)
    return len(areas)


def sorted_cov(slam: SlamFilter | CompressedFilter, order: np.ndarray) -> np.ndarray:
    index = np.concatenate([np.arange(3), (3 + 2 * order[:, None] + np.arange(2)).ravel()])
    return slam.cov[np.ix_(index, index)]


@pytest.mark.parametrize("area_radius", [1.0, 4.0, 1e3])
@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_equals_the_full_filter_on_random_recordings(sensor: str, area_radius: float) -> None:
    _, recording = random_recording(7, sensor=sensor, steps=120, landmarks=15)
    assert_equal_all_along(recording, area_radius)


def test_equals_the_full_filter_on_the_bench_workload_across_many_areas() -> None:
    _, recording = simulate(workload(60), 1)
    assert assert_equal_all_along(recording.first(700), 8.0) > 10


def test_a_new_landmark_seen_twice_in_one_step() -> None:
    twice = Observations(np.array([4, 4]), np.array([[2.0, 1.0], [2.2, 1.0]]), np.tile(np.eye(2) * 0.04, (2, 1, 1)))
    again = Observations(np.array([4]), np.array([[2.1, 0.9]]), np.eye(2)[None] * 0.04)
    prior = "position", np.zeros(3), np.eye(3) * 0.01
    full, compressed = SlamFilter(*prior), CompressedFilter(*prior, area_radius=0.5)
    for slam in (full, compressed):
        slam.update(twice)
        slam.predict([1.0, 0.0, 0.1], np.eye(3) * 0.01)
        slam.update(again)
    np.testing.assert_allclose(compressed.cov, full.cov, rtol=0, atol=1e-12)
    np.testing.assert_allclose(compressed.landmarks, full.landmarks, rtol=0, atol=1e-12)


def test_unknown_association_is_refused() -> None:
    slam = CompressedFilter("position", np.zeros(3), np.eye(3), 5.0)
    with pytest.raises(ValueError, match="known association"):
        slam.update(Observations(None, np.zeros((1, 2)), np.eye(2)[None]))
