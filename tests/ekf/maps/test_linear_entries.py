"""State entries and measurements with given Jacobians, compared with dense algebra on random states."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import SlamFilter, textbook
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.ekf.maps.map_state import NewEntries
from slamgauge.recording import Observations
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_covariances
from tests.reference.textbook import J, exp_action

CORRECTIONS = pytest.mark.parametrize("correction", RULES)


def random_cov(rng: np.random.Generator, size: int, scale: float = 0.1) -> Float:
    root = scale * rng.normal(size=(size, size))
    return root @ root.T


class Twin:
    """Dense state and covariance in the order of the filter's slots, which are points or not."""

    def __init__(self, rng: np.random.Generator, correction: Correction) -> None:
        self.x, self.P = np.array([0.0, 0.0, 3.0]), random_cov(rng, 3)  # `entries` are relative to the start
        self.ids: list[int] = []
        self.is_point: list[bool] = []
        self.invariant = correction == "right-invariant"
        self.rng = rng
        self.slam = SlamFilter("position", self.x, self.P, correction, landmarks=2)  # the map must grow

    def add(self, points: list[bool]) -> None:
        """Append slots that depend on three entries of the state."""
        count, first = len(points), max(self.ids, default=0) + 7
        ids = [first + 3 * k for k in range(count)]
        columns = self.rng.permutation(len(self.x))[:3]
        H, own = self.rng.normal(size=(2 * count, 3)), random_cov(self.rng, 2 * count)
        values = self.rng.uniform(-3, 3, 2 * count)
        self.slam.map.add_entries(np.array(ids), NewEntries(values, columns, H, own, points))
        T = np.vstack([np.eye(len(self.x)), np.zeros((2 * count, len(self.x)))])
        T[len(self.x) :, columns] = H
        self.P = T @ self.P @ T.T
        self.P[len(self.x) :, len(self.x) :] += own
        self.x, self.ids, self.is_point = np.append(self.x, values), self.ids + ids, self.is_point + points

    def correct(self) -> None:
        """Update with a measurement of entries of the robot and of two slots."""
        named = self.rng.permutation(self.ids)[:2]
        columns = np.concatenate([[0, 1, 2], self.slam.map.columns_of(named)])
        mine = [3 + 2 * self.ids.index(name) + k for name in named.tolist() for k in range(2)]
        assert columns[3:].tolist() == mine
        np.testing.assert_allclose(self.slam.map.entries(columns), self.x[columns], rtol=0, atol=1e-10)
        np.testing.assert_allclose(
            self.slam.map.covariances(columns, columns), self.P[np.ix_(columns, columns)], rtol=0, atol=1e-10
        )
        H, v = np.zeros((3, len(self.x))), self.rng.normal(size=3)
        H[:, columns] = self.rng.normal(size=(3, 7))
        R = random_covariances(self.rng, 1, np.full(3, 0.5))[0]
        nis = self.slam.map.update_linear(columns, H[:, columns], v, R)
        S = H @ self.P @ H.T + R
        assert nis == pytest.approx(v @ np.linalg.solve(S, v), rel=1e-9)
        D = self.to_additive()
        K = np.linalg.inv(D) @ self.P @ H.T @ np.linalg.inv(S)  # gain in the coordinates of the error
        P = np.linalg.inv(D) @ (self.P - self.P @ H.T @ np.linalg.inv(S) @ H @ self.P) @ np.linalg.inv(D).T
        self.x = self.moved(K @ v)
        D = self.to_additive()
        self.P = D @ P @ D.T

    def to_additive(self) -> Float:
        """Return D of the additive error D xi: rotations of the robot rotate the points only."""
        D = np.eye(len(self.x))
        if self.invariant:
            for first in self.turning():
                D[first : first + 2, 2] = J @ self.x[first : first + 2]
        return D

    def moved(self, xi: Float) -> Float:
        x = self.x + xi
        if self.invariant:
            for first in self.turning():
                pose = np.concatenate([self.x[first : first + 2], [0.0]])
                part = np.concatenate([xi[first : first + 2], xi[2:3]])
                x[first : first + 2] = exp_action(part, pose)[:2]
        x[2] = wrap(x[2])
        return x

    def turning(self) -> list[int]:
        return [0] + [3 + 2 * slot for slot, point in enumerate(self.is_point) if point]

    def remove(self, slot: int) -> None:
        """Remove a slot; the last one moves into it."""
        self.slam.map.remove(self.ids[slot])
        order = [*range(len(self.ids) - 1)]
        if slot < len(order):
            order[slot] = len(self.ids) - 1
        kept = np.array([0, 1, 2, *(3 + 2 * s + k for s in order for k in range(2))])
        self.x, self.P = self.x[kept], self.P[np.ix_(kept, kept)]
        self.ids, self.is_point = [self.ids[s] for s in order], [self.is_point[s] for s in order]

    def predict(self) -> None:
        increment, Q = self.rng.normal(size=3), random_cov(self.rng, 3)
        self.slam.predict(increment, Q)
        self.x, self.P, _ = textbook.predict(textbook.Belief(self.x, self.P, ()), increment, Q)

    def check(self) -> None:
        np.testing.assert_array_equal(self.slam.landmark_ids, self.ids)
        np.testing.assert_allclose(self.slam.pose, self.x[:3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(self.slam.landmarks.ravel(), self.x[3:], rtol=0, atol=1e-10)
        np.testing.assert_allclose(self.slam.cov, self.P, rtol=0, atol=1e-10)


@CORRECTIONS
@pytest.mark.parametrize("seed", range(3))
def test_a_state_of_points_and_other_slots_equals_the_dense_reference(correction: Correction, seed: int) -> None:
    """Slots are appended, corrected, and removed from the start, the middle and the end."""
    twin = Twin(np.random.default_rng(seed), correction)
    # test_filters_against_textbook tests predictions from first estimates
    if RULES[correction].first_estimates:
        twin.predict = lambda: None
    for points in ([True, False], [True], [False, True, True, False], [True, False, True]):
        twin.add(points)
        twin.check()
        twin.correct()
        twin.predict()
        twin.check()
    for slot in (1, 0, 7, 3, 2):
        twin.remove(slot % len(twin.ids))
        twin.check()
        twin.correct()
        twin.check()
    assert {*twin.is_point} == {True, False}
    twin.add([False, True])
    twin.remove(0)
    twin.correct()
    twin.check()


def test_a_landmark_in_a_freed_slot_is_a_point() -> None:
    """The earlier slot was not a point."""
    slam = SlamFilter("position", np.zeros(3), 0.1 * np.eye(3), "right-invariant", landmarks=1)
    new = NewEntries(np.zeros(2), np.arange(3), np.eye(3)[1:], np.zeros((2, 2)), [False])
    slam.map.add_entries(np.array([5]), new)
    slam.map.remove(5)
    fresh = SlamFilter("position", np.zeros(3), 0.1 * np.eye(3), "right-invariant", landmarks=1)
    for each in (slam, fresh):
        each.update(Observations(np.array([1]), np.array([[3.0, 1.0]]), 0.01 * np.eye(2)[None]))
        each.predict(np.ones(3), np.eye(3))
        each.update(Observations(np.array([1]), np.array([[3.0, 2.0]]), 0.01 * np.eye(2)[None]))
    np.testing.assert_array_equal(slam.landmarks, fresh.landmarks)
    np.testing.assert_array_equal(slam.cov, fresh.cov)


@CORRECTIONS
def test_a_linear_correction_without_solution_is_refused_and_changes_nothing(correction: Correction) -> None:
    twin = Twin(np.random.default_rng(9), correction)
    twin.add([True, False])
    columns: Int = np.arange(3)
    for innovation, noise, slope in ((np.nan, 1.0, 1.0), (1.0, -1e3, 1.0), (1.0, np.nan, 1.0), (1.0, 1.0, np.nan)):
        with pytest.raises(ValueError, match=r"^observation: no update exists; make every value finite[^\n]*$"):
            twin.slam.map.update_linear(columns, np.full((1, 3), slope), np.array([innovation]), np.array([[noise]]))
        twin.check()
