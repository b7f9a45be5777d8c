"""Removing and merging landmarks, compared with dense algebra."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import SlamFilter
from slamgauge.ekf.kernels.individual_compatibility import find_duplicates
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.recording import Observations
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_covariances, random_recording
from tests.reference.textbook import DenseFilter, Kind, additive_from_invariant, belief_of, exp_action, fill_map

CORRECTIONS = pytest.mark.parametrize("correction", RULES)
KINDS: dict[Correction, Kind] = {
    "standard": "standard",
    "iterated": "iterated",
    "first-estimates": "first-estimates",
    "observability-constrained": "observable",
    "right-invariant": "invariant",
}
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])


def state_of(slam: SlamFilter) -> Float:
    return np.concatenate([slam.pose, slam.landmarks.ravel()])


def random_filter(seed: int, correction: Correction, sensor: str = "position", landmarks: int = 5) -> SlamFilter:
    """Return a filter with landmarks, correlated with the robot and with each other."""
    rng = np.random.default_rng(seed)
    size = 3 + 2 * landmarks
    root = 0.1 * rng.normal(size=(size, size))
    P = root @ root.T
    P[2] *= 0.3
    P[:, 2] *= 0.3
    slam = SlamFilter(sensor, [0.5, -0.4, 3.0], P[:3, :3], correction, landmarks=landmarks)
    positions = rng.uniform(2, 4, (landmarks, 2)) * rng.choice([-1, 1], (landmarks, 2))
    fill_map(slam.map, np.arange(landmarks) * 10, positions, P)
    return slam


def merge(slam: SlamFilter, kept: int, gone: int) -> None:
    """Merge the landmarks in two slots, as `Tracks` does."""
    one, other = slam.landmark_ids[[kept, gone]].tolist()
    slam.map.equate(one, other)
    slam.map.remove(other)


def entries(slots: list[int]) -> Int:
    """Return the state entries of the robot and of landmarks."""
    return np.array([0, 1, 2, *(3 + 2 * s + k for s in slots for k in range(2))])


# --- removal -------------------------------------------------------------------------------------


@CORRECTIONS
@SENSORS
@pytest.mark.parametrize("slot", [0, 3, 6])
def test_removal_equals_never_observing_the_landmark_again(correction: Correction, sensor: str, slot: int) -> None:
    """Removal is marginalisation: later results for the rest are the same."""
    _, recording = random_recording(slot, sensor=sensor, landmarks=7)
    assert recording.landmark is not None
    keeps = SlamFilter(sensor, recording.prior_mean, recording.prior_cov, correction)
    removes, removed = keeps, 0
    for k, scan in enumerate(recording.scans()):
        assert scan.landmark is not None
        if k == 15:
            removed = int(keeps.landmark_ids[slot])
            removes = deepcopy(keeps)
            removes.map.remove(int(removes.landmark_ids[slot]))
        if k >= 15:
            rest = scan.landmark != removed
            scan = Observations(scan.landmark[rest], scan.value[rest], scan.cov[rest])
        for slam in (keeps, removes) if k >= 15 else (keeps,):
            if k:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            slam.update(scan)
    slots = [keeps.landmark_ids.tolist().index(name) for name in removes.landmark_ids]
    assert sorted([*slots, slot]) == list(range(7))
    np.testing.assert_allclose(state_of(removes), state_of(keeps)[entries(slots)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(removes.cov, keeps.cov[np.ix_(entries(slots), entries(slots))], rtol=0, atol=1e-12)
    removes.update(Observations(np.array([removed]), recording.observation[:1], recording.observation_cov[:1]))
    assert removes.landmark_ids[-1] == removed  # re-observed, it is new


# --- merging -------------------------------------------------------------------------------------


def dense_merge(correction: Correction, x: Float, P: Float, a: int, b: int) -> tuple[Float, Float]:
    """Apply the Kalman update with l_a - l_b = 0; for the right-invariant filter in the coordinates of its error."""
    invariant = correction == "right-invariant"
    H = np.zeros((2, len(x)))
    H[:, 3 + 2 * a : 5 + 2 * a], H[:, 3 + 2 * b : 5 + 2 * b] = np.eye(2), -np.eye(2)
    D = additive_from_invariant(x) if invariant else np.eye(len(x))
    r, H = -H @ x, H @ D
    P = np.linalg.inv(D) @ P @ np.linalg.inv(D).T
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T)
    P = (np.eye(len(x)) - K @ H) @ P
    x = exp_action(K @ r, x) if invariant else x + K @ r
    x[2] = wrap(x[2])
    D = additive_from_invariant(x) if invariant else np.eye(len(x))
    return x, D @ P @ D.T


@CORRECTIONS
@pytest.mark.parametrize(("kept", "gone"), [(0, 1), (3, 1), (1, 4), (4, 2)])
def test_merging_is_the_exact_observation_of_a_zero_difference(correction: Correction, kept: int, gone: int) -> None:
    slam = random_filter(1, correction)
    before = slam.pose
    x, P = dense_merge(correction, state_of(slam), slam.cov, kept, gone)
    merge(slam, kept, gone)
    rest = [s if s != gone else 4 for s in range(4)]
    np.testing.assert_array_equal(slam.landmark_ids, np.array(rest) * 10)
    np.testing.assert_allclose(state_of(slam), x[entries(rest)], rtol=0, atol=1e-11)
    np.testing.assert_allclose(slam.cov, P[np.ix_(entries(rest), entries(rest))], rtol=0, atol=1e-11)
    eigenvalues = np.linalg.eigvalsh(slam.cov)
    assert eigenvalues[0] > -1e-15 * eigenvalues[-1]
    assert np.abs(slam.pose - before).max() > 0.01
    assert abs(slam.pose[2]) <= np.pi


@CORRECTIONS
@pytest.mark.parametrize(("kept", "gone"), [(1, 4), (4, 1), (0, 2)])
def test_merging_a_landmark_with_its_exact_copy_changes_nothing(correction: Correction, kept: int, gone: int) -> None:
    original = random_filter(4, correction)
    copied = entries([gone if s == kept else s for s in range(5)])
    slam = SlamFilter("position", original.pose, original.pose_cov, correction)
    landmarks = state_of(original)[copied][3:].reshape(-1, 2)
    fill_map(slam.map, original.landmark_ids, landmarks, original.cov[np.ix_(copied, copied)])
    x, P = state_of(slam), slam.cov
    merge(slam, kept, gone)
    rest = entries([s if s != gone else 4 for s in range(4)])
    np.testing.assert_array_equal(state_of(slam), x[rest])
    np.testing.assert_array_equal(slam.cov, P[np.ix_(rest, rest)])


@CORRECTIONS
@SENSORS
def test_a_filter_after_a_merge_equals_the_textbook(correction: Correction, sensor: str) -> None:
    """The first estimate of the merged landmark is that of the kept one."""
    slam, rng = random_filter(5, correction, sensor), np.random.default_rng(5)
    twin = DenseFilter(sensor, state_of(slam), slam.cov, KINDS[correction])
    for slots in ([0, 1, 2], [3, 0], [1, 2]):
        increment, Q = np.array([0.3, 0.1, 0.2]), random_covariances(rng, 1, np.array([0.1, 0.1, 0.05]))[0]
        z = observation_near(slam, sensor, slots, rng)
        R = random_covariances(rng, len(slots), np.array([0.1, 0.05]))
        twin.predict(increment, Q)
        twin.update(slots, z, R)
        slam.predict(increment, Q)
        slam.update(Observations(slam.landmark_ids[slots], z, R))
        if slots == [3, 0]:
            x, P = dense_merge(correction, twin.x, twin.cov, 2, 1)
            kept = entries([0, 4, 2, 3])
            twin.x, twin.first = x[kept], twin.first[kept]
            twin.cov = P[np.ix_(kept, kept)]
            merge(slam, 2, 1)
    np.testing.assert_allclose(state_of(slam), twin.x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(slam.cov, twin.cov, rtol=0, atol=1e-10)


def observation_near(slam: SlamFilter, sensor: str, slots: list[int], rng: np.random.Generator) -> Float:
    offset = slam.landmarks[slots] - slam.pose[:2]
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - slam.pose[2] + 0.1 * rng.normal(size=len(slots))
    distance = np.hypot(*offset.T) + 0.1 * rng.normal(size=len(slots))
    if sensor == "position":
        return distance[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    return np.column_stack([distance, wrap(bearing)])


# --- duplicates ----------------------------------------------------------------------------------


def test_duplicates_equal_those_found_by_numpy() -> None:
    rng = np.random.default_rng(6)
    outcomes = {"found": 0, "none": 0, "not by place alone": 0}
    for _ in range(300):
        n, gate = 6, float(rng.choice([4.0, 9.0]))
        root = rng.normal(size=(15, 15)) * 10 ** rng.uniform(-2, -0.5, (15, 1))
        P, x = root @ root.T, np.concatenate([np.zeros(3), rng.uniform(-1, 1, 2 * n)])
        slots = np.sort(rng.permutation(n)[: int(rng.integers(0, 4))])
        apart = rng.random((n, n)) < 0.3
        apart |= apart.T
        near: list[list[int]] = []
        for a in slots.tolist():
            for b in range(n):
                M = np.zeros((2, 15))
                M[:, 3 + 2 * a : 5 + 2 * a] += np.eye(2)
                M[:, 3 + 2 * b : 5 + 2 * b] -= np.eye(2)
                d, C = M @ x, M @ P @ M.T
                if a == b or d @ np.linalg.inv(C) @ d > gate:
                    continue
                if apart[a, b]:
                    outcomes["not by place alone"] += 1
                    continue
                near.append([a, b])
        assert find_duplicates(belief_of(x, np.triu(P)), slots, apart[slots], gate).tolist() == near
        outcomes["found" if near else "none"] += 1
    assert min(outcomes.values()) > 30, outcomes
