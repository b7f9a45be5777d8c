"""Duplicate landmarks: weights compared with all matchings, the robot with conditional Gaussians."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.individual_compatibility import NONE
from slamgauge.ekf.maps.duplicate_landmarks import find_matchings, robot_of
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import replace_map

DENSITY = 1e-2
PAIRS = np.array([[3, 0], [3, 1], [4, 0], [4, 2]])  # slots of two tracks and of their possible landmarks


def drawn(seed: int) -> tuple[LandmarkMap, Float, Float]:
    """Return a map of five landmarks, the last two near the first, with state (13,) and covariance (13, 13)."""
    rng = np.random.default_rng(seed)
    root = 0.3 * rng.normal(size=(13, 13))
    cov = root @ root.T
    places = np.array([[4.0, 0.0], [4.5, 0.5], [4.0, 1.0], [4.2, 0.2], [4.1, 0.7]]) + 0.1 * rng.normal(size=(5, 2))
    landmarks = LandmarkMap("range-bearing", np.zeros(3), np.eye(3), "standard", landmarks=8)
    replace_map(landmarks, np.arange(5), places, cov)
    return landmarks, np.concatenate([np.zeros(3), places.ravel()]), cov


def difference(pairs: Float) -> Float:
    """Return the Jacobian (2k, 13) of track minus landmark for pairs (k, 2) of slots."""
    rows = np.zeros((2 * len(pairs), 13))
    for number, (track, landmark) in enumerate(pairs):
        rows[2 * number : 2 * number + 2, 3 + 2 * track : 5 + 2 * track] = np.eye(2)
        rows[2 * number : 2 * number + 2, 3 + 2 * landmark : 5 + 2 * landmark] = -np.eye(2)
    return rows


def all_matchings() -> list[list[int]]:
    """Return the pairs of each matching: at most one for each track and each landmark."""
    chosen = itertools.product([NONE, 0, 1], [NONE, 2, 3])
    matchings = [[each for each in both if each != NONE] for both in chosen]
    return [each for each in matchings if len({*PAIRS[each, 1].tolist()}) == len(each)]


def weight_of(matching: list[int], state: Float, cov: Float) -> float:
    M = difference(PAIRS[matching])
    d, C = M @ state, M @ cov @ M.T
    density = np.exp(-0.5 * d @ np.linalg.solve(C, d)) / np.sqrt(np.linalg.det(2.0 * np.pi * C)) if matching else 1.0
    return float(density) * DENSITY ** (2 - len(matching))


@pytest.mark.parametrize("seed", range(5))
def test_weights_equal_those_of_all_matchings(seed: int) -> None:
    landmarks, state, cov = drawn(seed)
    found = find_matchings(landmarks, PAIRS, np.array([9, 9, 9, 5, 5]), DENSITY)
    expected = {tuple(each): weight_of(each, state, cov) for each in all_matchings()}
    total = sum(expected.values())
    assert len(found.weight) == len(expected) == 8
    assert (np.diff(found.weight) <= 0.0).all()
    for chosen, weight in zip(found.chosen, found.weight, strict=True):
        matching = tuple(sorted(chosen[chosen != NONE].tolist()))
        assert weight == pytest.approx(expected[matching] / total, rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_robot_is_the_mean_over_matchings(seed: int) -> None:
    landmarks, state, cov = drawn(seed)
    found = find_matchings(landmarks, PAIRS, np.array([9, 9, 9, 5, 5]), DENSITY)
    heavy = found.weight >= 1e-3
    share = found.weight[heavy] / found.weight[heavy].sum()
    means, covs = list[Float](), list[Float]()
    for chosen in found.chosen[heavy]:
        M = difference(PAIRS[chosen[chosen != NONE]])
        K = cov @ M.T @ np.linalg.inv(M @ cov @ M.T)
        means.append((state - K @ M @ state)[:3])
        covs.append((cov - K @ M @ cov)[:3, :3])
    mean = share @ np.array(means)
    spread = np.array(means) - mean
    expected = np.einsum("h,hij->ij", share, np.array(covs) + spread[:, :, None] * spread[:, None, :])
    pose, pose_cov = robot_of(landmarks, found)
    np.testing.assert_allclose(pose, mean, atol=1e-6)
    np.testing.assert_allclose(pose_cov, expected, atol=1e-6)


def test_pairs_with_nearly_all_weight_are_agreed() -> None:
    landmarks, state, cov = drawn(0)
    found = find_matchings(landmarks, PAIRS, np.array([9, 9, 9, 5, 5]), DENSITY)
    weights = {tuple(each): weight_of(each, state, cov) for each in all_matchings()}
    total = sum(weights.values())
    shares = [sum(each for pairs, each in weights.items() if pair in pairs) / total for pair in range(4)]
    best = found.chosen[0][found.chosen[0] != NONE]
    for certainty in (0.5 * min(shares), max(shares) + 1e-3):
        agreed = [PAIRS[pair].tolist() for pair in best if shares[pair] >= certainty]
        assert found.agreed(certainty).tolist() == agreed
