"""State entries, corrections with given Jacobians, removal and merging, compared with dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import SlamFilter, textbook
from slamgauge.ekf.kernels.individual_compatibility import find_duplicates
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.ekf.maps.map_state import NewEntries
from slamgauge.recording import Observations
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_covariances
from tests.reference.textbook import J, belief_of, exp_action

CORRECTIONS = pytest.mark.parametrize("correction", RULES)


def random_cov(rng: np.random.Generator, size: int, scale: float = 0.1) -> Float:
    root = scale * rng.normal(size=(size, size))
    return root @ root.T


class Twin:
    """Dense state and covariance in the order of the filter's slots, which are points or not."""

    def __init__(self, seed: int, correction: Correction) -> None:
        self.rng = np.random.default_rng(seed)
        self.x, self.P = np.array([0.0, 0.0, 3.0]), random_cov(self.rng, 3)  # `entries` are relative to the start
        self.first = self.x.copy()  # first estimates
        self.ids: list[int] = []
        self.is_point: list[bool] = []
        self.rule = RULES[correction]
        self.slam = SlamFilter("position", self.x, self.P, correction, landmarks=2)  # the map must grow

    def add(self, points: list[bool], copied: int | None = None) -> None:
        """Append slots that depend on three entries of the state; or exact copies of the landmark in a slot."""
        count, size = len(points), len(self.x)
        ids = [max(self.ids, default=0) + 7 + 3 * k for k in range(count)]
        if copied is None:
            columns, own = self.rng.permutation(size)[:3], random_cov(self.rng, 2 * count)
            H, values = self.rng.normal(size=(2 * count, 3)), self.rng.uniform(-3, 3, 2 * count)
        else:
            columns, own = 3 + 2 * copied + np.arange(2), np.zeros((2 * count, 2 * count))
            H, values = np.tile(np.eye(2), (count, 1)), np.tile(self.x[columns], count)
        self.slam.map.add_entries(np.array(ids), NewEntries(values, columns, H, own, points))
        T = np.vstack([np.eye(size), np.zeros((2 * count, size))])
        T[size:, columns] = H
        self.P = T @ self.P @ T.T
        self.P[size:, size:] += own
        self.x, self.first = np.append(self.x, values), np.append(self.first, values)
        self.ids, self.is_point = self.ids + ids, self.is_point + points

    def correct(self) -> None:
        """Update with a measurement of entries of the robot and of two slots."""
        named = self.rng.permutation(self.ids)[:2]
        columns = np.concatenate([[0, 1, 2], self.slam.map.columns_of(named)])
        mine = [3 + 2 * self.ids.index(name) + k for name in named.tolist() for k in range(2)]
        assert columns[3:].tolist() == mine
        np.testing.assert_allclose(self.slam.map.entries(columns), self.x[columns], rtol=0, atol=1e-10)
        block = self.slam.map.covariances(columns, columns)
        np.testing.assert_allclose(block, self.P[np.ix_(columns, columns)], rtol=0, atol=1e-10)
        jacobian, v = self.rng.normal(size=(3, 7)), self.rng.normal(size=3)
        R = random_covariances(self.rng, 1, np.full(3, 0.5))[0]
        nis = self.slam.map.update_linear(columns, jacobian, v, R)
        assert nis == pytest.approx(self.condition(columns, jacobian, v, R), rel=1e-9)

    def condition(self, columns: Int, jacobian: Float, v: Float, R: Float) -> float:
        """Apply the Kalman update in the coordinates of the filter's error; return the NIS."""
        H = np.zeros((len(v), len(self.x)))
        H[:, columns] = jacobian
        back = np.linalg.inv(self.to_additive())
        P, H = back @ self.P @ back.T, H @ self.to_additive()
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        self.x = self.moved(K @ v)
        D = self.to_additive()
        self.P = D @ (P - K @ S @ K.T) @ D.T
        return float(v @ np.linalg.solve(S, v))

    def turning(self) -> list[int]:
        """Return the first entry of each point: rotations of the right-invariant error turn them, and no other slot."""
        points = [3 + 2 * slot for slot, point in enumerate(self.is_point) if point]
        return [0, *points] if self.rule.form.invariant else []

    def to_additive(self) -> Float:
        D = np.eye(len(self.x))
        for first in self.turning():
            D[first : first + 2, 2] = J @ self.x[first : first + 2]
        return D

    def moved(self, xi: Float) -> Float:
        x = self.x + xi
        for first in self.turning():
            pose, part = np.append(self.x[first : first + 2], 0.0), np.append(xi[first : first + 2], xi[2])
            x[first : first + 2] = exp_action(part, pose)[:2]
        x[2] = wrap(x[2])
        return x

    def remove(self, slot: int) -> None:
        """Remove a slot; the last one moves into it."""
        self.slam.map.remove(self.ids[slot])
        order = [*range(len(self.ids) - 1)]
        if slot < len(order):
            order[slot] = len(self.ids) - 1
        kept = np.array([0, 1, 2, *(3 + 2 * s + k for s in order for k in range(2))])
        self.x, self.first, self.P = self.x[kept], self.first[kept], self.P[np.ix_(kept, kept)]
        self.ids, self.is_point = [self.ids[s] for s in order], [self.is_point[s] for s in order]

    def merge(self, kept: int, gone: int) -> None:
        """Merge the landmarks in two slots: their difference is zero."""
        self.slam.map.equate(self.ids[kept], self.ids[gone])
        columns = np.array([3 + 2 * slot + k for slot in (kept, gone) for k in range(2)])
        H = np.hstack([np.eye(2), -np.eye(2)])
        self.condition(columns, H, -H @ self.x[columns], np.zeros((2, 2)))
        self.remove(gone)

    def predict(self) -> None:
        """Move the robot, except in filters whose Jacobians are at first estimates."""
        if self.rule.first_estimates:
            return
        increment, Q = self.rng.normal(size=3), random_cov(self.rng, 3)
        self.slam.predict(increment, Q)
        self.x, self.P, _ = textbook.predict(textbook.Belief(self.x, self.P, ()), increment, Q)

    def check(self) -> None:
        slam = self.slam
        np.testing.assert_array_equal(slam.landmark_ids, self.ids)
        np.testing.assert_allclose(np.append(slam.pose, slam.landmarks), self.x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(slam.cov, self.P, rtol=0, atol=1e-10)
        if self.rule.first_estimates:
            np.testing.assert_array_equal(slam.map.belief.point[3 : len(self.x)], self.first[3:])


@CORRECTIONS
@pytest.mark.parametrize("seed", range(3))
def test_a_map_equals_the_dense_reference(correction: Correction, seed: int) -> None:
    """Slots are appended, corrected, and removed or merged at the start, in the middle and at the end."""
    twin = Twin(seed, correction)
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
    twin.add([True] * 5)
    for kept, gone in ((-5, -1), (-1, -3)):
        twin.merge(kept % len(twin.ids), gone % len(twin.ids))
        twin.check()
        twin.correct()
    eigenvalues = np.linalg.eigvalsh(twin.slam.cov)
    assert eigenvalues[0] > -1e-14 * eigenvalues[-1]
    assert {*twin.is_point} == {True, False}


@CORRECTIONS
def test_merging_a_landmark_with_its_exact_copy_changes_nothing(correction: Correction) -> None:
    twin = Twin(4, correction)
    twin.add([True, True])
    twin.add([True], copied=0)
    before = twin.slam.cov
    twin.slam.map.equate(twin.ids[2], twin.ids[0])
    np.testing.assert_array_equal(twin.slam.cov, before)
    twin.remove(0)
    twin.check()


def test_a_landmark_in_a_freed_slot_is_a_point() -> None:
    """The earlier slot was not a point."""
    used, fresh = (SlamFilter("position", np.zeros(3), 0.1 * np.eye(3), "right-invariant") for _ in range(2))
    new = NewEntries(np.zeros(2), np.arange(3), np.eye(3)[1:], np.zeros((2, 2)), [False])
    used.map.add_entries(np.array([5]), new)
    used.map.remove(5)
    for each in (used, fresh):
        for x in (1.0, 2.0):
            each.update(Observations(np.array([1]), np.array([[3.0, x]]), 0.01 * np.eye(2)[None]))
            each.predict(np.ones(3), np.eye(3))
    np.testing.assert_array_equal(used.landmarks, fresh.landmarks)
    np.testing.assert_array_equal(used.cov, fresh.cov)


@pytest.mark.parametrize(("v", "noise", "slope"), [(np.nan, 1, 1), (1, -1e3, 1), (1, np.nan, 1), (1, 1, np.nan)])
def test_a_correction_without_solution_is_refused_and_changes_nothing(v: float, noise: float, slope: float) -> None:
    twin = Twin(9, "right-invariant")
    twin.add([True, False])
    with pytest.raises(ValueError, match=r"^observation: no update exists; make every value finite[^\n]*$"):
        twin.slam.map.update_linear(np.arange(3), np.full((1, 3), slope), np.array([v]), np.array([[noise]]))
    twin.check()


def test_duplicates_equal_those_found_by_numpy() -> None:
    rng = np.random.default_rng(6)
    outcomes = {"found": 0, "none": 0, "not by place alone": 0}
    for _ in range(300):
        n, gate = 6, float(rng.choice([4.0, 9.0]))
        root = rng.normal(size=(15, 15)) * 10 ** rng.uniform(-2, -0.5, (15, 1))
        P, x = root @ root.T, np.append(np.zeros(3), rng.uniform(-1, 1, 2 * n))
        slots = np.sort(rng.permutation(n)[: int(rng.integers(0, 4))])
        apart = rng.random((len(slots), n)) < 0.3
        near: list[list[int]] = []
        for i, a in enumerate(slots.tolist()):
            for b in {*range(n)} - {a}:
                M = np.zeros((2, 15))
                M[:, 3 + 2 * a : 5 + 2 * a], M[:, 3 + 2 * b : 5 + 2 * b] = np.eye(2), -np.eye(2)
                d, C = M @ x, M @ P @ M.T
                if d @ np.linalg.inv(C) @ d <= gate:
                    near += [] if apart[i, b] else [[a, b]]
                    outcomes["not by place alone"] += bool(apart[i, b])
        assert find_duplicates(belief_of(x, np.triu(P)), slots, apart, gate).tolist() == near
        outcomes["found" if near else "none"] += 1
    assert min(outcomes.values()) > 30, outcomes
