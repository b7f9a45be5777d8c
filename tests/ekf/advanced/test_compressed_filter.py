"""The compressed filter equals the full one for both corrections."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.bench.step_times import workload
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import CompressedFilter, SlamFilter
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.errors import UserError
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between, rotation
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

BOTH = pytest.mark.parametrize("correction", ["standard", "right-invariant"])


def assert_equal_all_along(recording: Recording, area_radius: float, correction: Correction) -> int:
    """Compare pose and covariance at every step, the whole map every 50 steps; return how often an area was left."""
    prior = recording.sensor, recording.prior_mean, recording.prior_cov
    full = SlamFilter(*prior, correction)
    compressed = CompressedFilter(*prior, area_radius, correction=correction)
    areas = {id(compressed._local): compressed._local}
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            full.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            compressed.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        assert compressed.update(scan) == pytest.approx(full.update(scan))
        areas[id(compressed._local)] = compressed._local
        np.testing.assert_allclose(compressed.pose, full.pose, rtol=0, atol=1e-9)
        np.testing.assert_allclose(compressed.pose_cov, full.pose_cov, rtol=1e-9, atol=1e-12)
        if k % 50 == 0 or k == recording.steps:
            assert_same_map(compressed, full)
    return len(areas)


def assert_same_map(compressed: CompressedFilter, full: SlamFilter) -> None:
    assert set(compressed.landmark_ids) == set(full.landmark_ids)
    ours, theirs = np.argsort(compressed.landmark_ids), np.argsort(full.landmark_ids)
    np.testing.assert_allclose(compressed.landmarks[ours], full.landmarks[theirs], rtol=0, atol=1e-9)
    np.testing.assert_allclose(sorted_cov(compressed, ours), sorted_cov(full, theirs), rtol=0, atol=1e-9)


def sorted_cov(slam: SlamFilter | CompressedFilter, order: np.ndarray) -> np.ndarray:
    index = np.concatenate([np.arange(3), (3 + 2 * order[:, None] + np.arange(2)).ravel()])
    return slam.cov[np.ix_(index, index)]


@BOTH
@pytest.mark.parametrize("area_radius", [1.0, 4.0, 1e3])
@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_equals_the_full_filter_on_random_recordings(sensor: str, area_radius: float, correction: Correction) -> None:
    _, recording = random_recording(7, sensor=sensor, steps=120, landmarks=15)
    assert_equal_all_along(recording, area_radius, correction)


@BOTH
def test_equals_the_full_filter_on_the_bench_workload_across_many_areas(correction: Correction) -> None:
    _, recording = simulate(workload(60), 1)
    assert assert_equal_all_along(recording.first(300), 4.0, correction) > 10


NORTH, SOUTH = np.array([[40.0, 8.0], [36.0, 9.0], [41.0, 13.0]]), np.array([[1.0, 2.0], [3.0, -1.0]])


def seen_from(pose: Float, places: Float, ids: list[int], variance: float = 0.01) -> Observations:
    """Return positions `places` (m, 2) in the body frame of a pose (3,)."""
    covs = np.tile(variance * np.eye(2), (len(ids), 1, 1))
    return Observations(np.array(ids), (places - pose[:2]) @ rotation(pose[2]), covs)


def in_another_area(correction: Correction) -> tuple[SlamFilter, CompressedFilter]:
    """Return both filters after a second drive to two landmarks, with a large heading error there."""
    north, south = np.array([40.0, 10.0, 0.5]), np.array([0.0, 0.0, 0.8])
    prior = "position", north, np.diag([0.01, 0.01, 0.01])
    full, compressed = SlamFilter(*prior, correction), CompressedFilter(*prior, area_radius=6.0, correction=correction)
    for slam in (full, compressed):
        slam.update(seen_from(north, NORTH, [7, 8, 9], 0.1))
        for start, end in ((north, south), (south, north), (north, south)):
            slam.predict(between(start, end), np.diag([0.05, 0.05, 1e-4]))
            slam.update(seen_from(end, SOUTH, [1, 2], 0.1) if end is south else seen_from(end, NORTH, [7, 8, 9], 0.1))
        slam.predict([0.0, 0.0, 0.0], np.diag([1e-4, 1e-4, 1.0]))
    return full, compressed


@BOTH
@pytest.mark.parametrize("turn", [-3.0, -1.0, 1e-9, 0.4, 2.5])
def test_a_huge_turn_of_the_rest_of_the_map(turn: float, correction: Correction) -> None:
    """Observations rotate the robot by radians; the rest of the map moves by V dx and rotates with it."""
    full, compressed = in_another_area(correction)
    rest = full.landmarks[:3]
    for k in range(4):
        scan = seen_from(full.pose + np.array([0.5, 0.1, turn / (k + 1)]), full.landmarks[3:], [1, 2])
        assert compressed.update(scan) == pytest.approx(full.update(scan))
        for slam in (full, compressed):
            slam.predict([0.3, 0.1, 0.2], np.diag([0.05, 0.02, 0.5]))
    assert np.abs(full.landmarks[:3] - rest).max() > 1e-4
    assert len(compressed._local.landmark_ids) == 2
    assert_same_map(compressed, full)


@BOTH
def test_landmarks_that_are_new_to_an_area_between_turns(correction: Correction) -> None:
    full, compressed = in_another_area(correction)
    for k in range(6):
        pose = full.pose + np.array([0.2, -0.1, 0.3])
        ids = [1, 2, 20 + k, 20 + k] if k % 2 else [2, 20 + k]
        scan = seen_from(pose, np.array([SOUTH[i - 1] if i < 3 else [0.5 * i - 9.0, 3.0] for i in ids]), ids)
        assert compressed.update(scan) == pytest.approx(full.update(scan))
        for slam in (full, compressed):
            slam.predict([0.3, 0.1, -0.2], np.diag([0.05, 0.02, 0.1]))
    assert not np.isin([7, 8, 9], compressed._local.landmark_ids).any()
    assert_same_map(compressed, full)


@BOTH
def test_a_refused_scan_leaves_pending_updates_unchanged(correction: Correction) -> None:
    full, compressed = in_another_area(correction)
    scan = seen_from(full.pose + 0.2, SOUTH, [1, 2])
    for slam in (full, compressed):
        slam.update(scan)
    twice = Observations(np.array([1, 30, 30]), np.array([[1.0, 2.0], [3.0, 1.0], [1e200, 1.0]]), scan.cov[[0, 0, 0]])
    for refused in (scan._replace(cov=-scan.cov), scan._replace(value=1e200 * scan.value), twice):
        with pytest.raises(UserError):
            compressed.update(refused)
    assert_same_map(compressed, full)


@pytest.mark.parametrize("correction", ["first-estimates", "observability-constrained", "iterated", RULES["iterated"]])
def test_other_corrections_are_refused(correction: Correction) -> None:
    with pytest.raises(
        UserError, match=r"^correction: .* has no account of an area; use standard or right-invariant[^\n]*$"
    ):
        CompressedFilter("position", np.zeros(3), np.eye(3), 5.0, correction=correction)


@BOTH
def test_a_new_landmark_observed_twice_in_a_step(correction: Correction) -> None:
    twice = Observations(np.array([4, 4]), np.array([[2.0, 1.0], [2.2, 1.0]]), np.tile(np.eye(2) * 0.04, (2, 1, 1)))
    again = Observations(np.array([4]), np.array([[2.1, 0.9]]), np.eye(2)[None] * 0.04)
    prior = "position", np.zeros(3), np.eye(3) * 0.01
    full, compressed = SlamFilter(*prior, correction), CompressedFilter(*prior, area_radius=0.5, correction=correction)
    for slam in (full, compressed):
        slam.update(twice)
        slam.predict([1.0, 0.0, 0.1], np.eye(3) * 0.01)
        slam.update(again)
    np.testing.assert_allclose(compressed.cov, full.cov, rtol=0, atol=1e-12)
    np.testing.assert_allclose(compressed.landmarks, full.landmarks, rtol=0, atol=1e-12)
