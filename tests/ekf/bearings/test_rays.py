"""Rays: their geometry, and the federated update compared with a dense reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge import load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, riekf, textbook
from slamgauge.ekf.bearings.bearing_filter import BearingFilter
from slamgauge.ekf.bearings.rays import (
    MIN_SHARE,
    distances_and_sigmas,
    keep,
    normalised,
    shares,
    weigh,
)
from slamgauge.ekf.settings import Rays
from slamgauge.recording import Observations
from slamgauge.se2 import compose
from tests.reference.random_recordings import noisy_bearings
from tests.reference.textbook import DenseFilter

pytestmark = pytest.mark.slow

FOUR = Rays(alpha=0.3, beta=2.0, s_min=1.0)  # four members


# --- equations -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("alpha", "beta", "s_min", "s_max", "distances"),
    [
        (0.3, 2.0, 1.0, 10.0, [1.43, 2.86, 5.71, 11.43]),
        (0.3, 3.0, 1.0, 50.0, [1.43, 4.29, 12.86, 38.57]),
        (0.2, 1.8, 1.0, 10.0, [1.25, 2.25, 4.05, 7.29, 13.12]),
        (0.3, 2.0, 9.0, 10.0, [12.86]),
    ],
)
def test_distances_and_sigmas_of_members(alpha: float, beta: float, s_min: float, s_max: float, distances: list[float]):
    s, sigma = distances_and_sigmas(Rays(alpha, beta, s_min, s_max))
    np.testing.assert_allclose(s, distances, atol=5e-3)
    np.testing.assert_allclose(sigma, alpha * s, rtol=1e-15)
    assert s[0] - sigma[0] == pytest.approx(s_min)
    assert s[-1] + sigma[-1] >= s_max


def test_weights_are_multiplied_by_likelihoods_and_normalised():
    """Likelihoods, without the factor 1 / sqrt(2 pi): exp(0) / 1 and exp(-2 / 2) / 2."""
    found = np.exp(weigh(np.log([0.25, 0.75]), np.array([0.0, np.sqrt(8.0)]), np.array([1.0, 4.0]), 0.5))
    products = np.array([0.25 * 1.0, 0.75 * np.exp(-1.0) / 2.0])
    np.testing.assert_allclose(found, products / products.sum(), rtol=1e-14)
    found = np.exp(weigh(np.log([0.5, 0.5]), np.array([3.0, 3.1]), np.array([1e-4, 1e-4]), 1e-5))
    assert found.tolist() == [1.0, 0.0]  # likelihoods of exp(-45 000) and less are below the smallest double


def test_every_bearing_of_a_member_at_the_robot_is_equally_likely():
    """The variance of its innovation is R, whose square root would be the most likely standard deviation."""
    found = np.exp(weigh(np.log([0.5, 0.5]), np.array([0.0, 0.1]), np.array([0.01, 0.02]), 0.01))
    likelihoods = np.array([1.0 / (2.0 * np.pi), np.exp(-0.25) / np.sqrt(2.0 * np.pi * 0.02)])
    np.testing.assert_allclose(found, likelihoods / likelihoods.sum(), rtol=1e-14)


@pytest.mark.parametrize(
    ("weights", "distances", "least", "kept"),
    [
        ([0.5, 0.3, 0.1999, 0.0001], [1.0, 2.0, 4.0, 8.0], 0.001 / 4, [True, True, True, False]),
        ([0.5, 0.3, 0.1997, 0.0003], [1.0, 2.0, 4.0, 8.0], 0.001 / 4, [True, True, True, True]),
        ([0.4, 0.6], [2.0, 2.3], 0.001 / 4, [False, True]),  # nearly the same distance: the heavier one
        ([0.6, 0.4], [2.3, 2.0], 0.001 / 4, [True, False]),
        ([0.4, 0.6], [2.0, 2.5], 0.001 / 4, [True, True]),  # 1.25 times the distance
        ([0.0001, 0.5, 0.4999], [3.0, 2.0, 2.3], 0.001 / 4, [False, True, False]),  # two remain after the first rule
        ([1.0], [5.0], 0.001 / 4, [True]),
        ([0.2, 0.5, 0.3], [1.0, 2.0, 4.0], 0.9, [False, True, False]),  # the heaviest always remains
    ],
)
def test_which_members_remain(weights: list[float], distances: list[float], least: float, kept: list[bool]):
    assert keep(np.log(weights), np.array(distances), least).tolist() == kept


def test_shares_are_the_weights_of_members_that_are_heavy_enough():
    np.testing.assert_array_equal(shares(np.array([0.62, 0.05, 0.33])), [0.62, 0.05, 0.33])
    np.testing.assert_array_equal(shares(np.array([0.62, 0.04, 0.34])), [0.62, 0.0, 0.34])
    np.testing.assert_array_equal(shares(np.ones(1)), [1.0])  # a point receives the whole bearing


@given(st.lists(st.floats(-700.0, 0.0), min_size=1, max_size=30))
def test_a_ray_receives_at_most_the_information_of_a_bearing(logarithms: list[float]):
    weights = np.exp(normalised(np.array(logarithms)))
    assert weights.sum() == pytest.approx(1.0)
    assert shares(weights).sum() <= 1.0 + 1e-14


# --- rays of a map -------------------------------------------------------------------------------


class Twin(DenseFilter):
    """A ray on full matrices: members at ranges (4.1) to (4.4), weights as products, a stacked federated update."""

    def __init__(self, mean: Float, cov: Float, rays: Rays) -> None:
        super().__init__("range-bearing", mean, cov, "standard")
        self.rays, self.weights = rays, np.full(rays.member_count, 1.0 / rays.member_count)

    def begin(self, z: float, R: float) -> None:
        for s in distances_and_sigmas(self.rays)[0]:
            self.augment(np.array([s, z]), np.diag([(self.rays.alpha * s) ** 2, R]))

    def linearised(self, z: float, R: float) -> tuple[Float, Float]:
        """Return the innovation (n,) of each member, and its Jacobian (n, size)."""
        slots = np.arange(len(self.weights))
        given = np.full((len(slots), 1), z), np.full((len(slots), 1, 1), R)
        v, H, _ = textbook.stack(textbook.linearise("bearing", self.x, slots, *given), len(self.x))
        return v, H

    def bear(self, z: float, R: float) -> None:
        """Update with a bearing."""
        v, H = self.linearised(z, R)
        Z = np.einsum("ni,ij,nj->n", H, self.P, H) + R
        self.weights = self.weights * np.exp(-(v**2) / (2 * Z)) / np.sqrt(Z)
        self.weights /= self.weights.sum()
        kept = self.weights >= self.rays.threshold / self.rays.member_count
        entries = np.append(np.ones(3, bool), np.repeat(kept, 2))
        self.x, self.P, self.weights = self.x[entries], self.P[np.ix_(entries, entries)], self.weights[kept]
        self.weights /= self.weights.sum()
        shared = self.weights >= MIN_SHARE
        v, H = (each[shared] for each in self.linearised(z, R))
        R_shared = np.diag(R / self.weights[shared])
        (self.x, self.P, _), _, _ = textbook.update(textbook.Belief(self.x, self.P, ()), v, H, R_shared)


def test_a_ray_equals_the_dense_reference_until_it_is_a_point():
    rng = np.random.default_rng(4)
    mean, cov = np.array([0.3, -0.2, 0.5]), np.diag([0.01, 0.02, 0.001])
    slam, twin = BearingFilter(mean, cov, initialisation=FOUR), Twin(mean, cov, FOUR)
    truth, landmark, R = mean, np.array([4.0, 3.5]), np.deg2rad(5.0) ** 2
    Q = np.diag([0.03, 0.0, 0.005]) ** 2
    members = [0]
    for k in range(120):
        if k > 0:
            increment = np.array([0.1, 0.0, 0.01])
            truth = compose(truth, increment)
            slam.predict(increment, Q)
            twin.predict(increment, Q)
        scan = noisy_bearings(truth, landmark[None], np.array([7]), rng, np.sqrt(R))
        slam.update(scan)
        z, R = float(scan.value[0, 0]), float(scan.cov[0, 0, 0])
        if k == 0:
            twin.begin(z, R)
        else:
            twin.bear(z, R)
        members.append(len(twin.weights))
        np.testing.assert_allclose(slam.pose, twin.x[:3], atol=1e-9)
        np.testing.assert_allclose(slam.pose_cov, twin.P[:3, :3], atol=1e-11)
        best = int(np.argmax(twin.weights))
        np.testing.assert_allclose(slam.landmarks[0], twin.x[3 + 2 * best : 5 + 2 * best], atol=1e-8)
        assert slam.provisional == ({7: len(twin.weights)} if len(twin.weights) > 1 else {})
        if len(twin.weights) == 1:
            break
    assert members[1] == 4
    assert members[-1] == 1
    assert len(members) > 10


def test_a_ray_whose_members_fail_the_gate_is_deleted():
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), initialisation=replace(FOUR, lost_after=3))

    def see(bearing: float) -> None:
        slam.update(Observations(np.array([1]), np.array([[bearing]]), np.array([[[1e-4]]])))

    see(0.0)
    before = slam.landmarks
    for _ in range(2):
        see(1.0)
        np.testing.assert_array_equal(slam.landmarks, before)
    assert slam.provisional == {1: 4}
    see(1.0)  # deleted, and started again along this bearing
    assert slam.provisional == {1: 4}
    np.testing.assert_allclose(np.arctan2(*slam.landmarks[0][::-1]), 1.0, atol=1e-12)


def test_for_a_member_at_the_robot_every_bearing_is_equally_likely():
    rays, variance = replace(FOUR, threshold=1e-9), 1e-2
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), initialisation=rays)
    for increment in (0.0, float(distances_and_sigmas(rays)[0][0])):
        slam.predict([increment, 0.0, 0.0], np.zeros((3, 3)))
        slam.update(Observations(np.array([1]), np.zeros((1, 1)), np.full((1, 1, 1), variance)))
    distances = distances_and_sigmas(rays)[0]
    far = distances[1:] - distances[0]
    Z = variance + variance * (distances[1:] / far) ** 2  # the first bearing's variance across the ray
    likelihood = np.append(1.0 / (2.0 * np.pi), 1.0 / np.sqrt(2.0 * np.pi * Z))
    np.testing.assert_allclose(slam.whole_map().weight, likelihood / likelihood.sum(), rtol=1e-9)


@pytest.mark.parametrize("estimator", [ekf_slam, riekf])
def test_estimators_map_every_landmark_of_the_ring(estimator: Any) -> None:
    truth, recording = simulate(load_scenario("q4-ring", ["start=sampled"]), 1)
    assert truth.poses is not None
    estimate = estimator(recording)
    assert set(estimate.landmark_ids.tolist()) == set(np.asarray(truth.landmark_ids).tolist())
    assert np.array_equal(estimate.association, np.asarray(recording.landmark))
    assert np.sqrt(np.square(estimate.poses - truth.poses)[:, :2].sum(axis=1).mean()) < 2.0
