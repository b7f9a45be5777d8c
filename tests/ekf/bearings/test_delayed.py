"""Delayed initialisation: placement is exact conditioning, and the window is bounded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from slamgauge.arrays import Float, Int
from slamgauge.ekf import textbook
from slamgauge.ekf.bearings.bearing_filter import BearingFilter
from slamgauge.ekf.bearings.delayed import IMPROBABLE, linearise_bearings
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.ekf.settings import FEWEST, Delayed
from slamgauge.recording import Observations
from slamgauge.se2 import compose, rotation, wrap
from slamgauge.triangulation import triangulate
from tests.reference.jacobians import assert_jacobian
from tests.reference.random_recordings import noisy_bearings

pytestmark = pytest.mark.slow

CORRECTIONS = pytest.mark.parametrize("correction", RULES)
J = np.array([[0.0, -1.0], [1.0, 0.0]])
SIGMA = np.deg2rad(1.0)
Q = np.diag([1e-2, 1e-3, 2e-3]) ** 2


def sights(
    pose: Float, landmarks: Float, names: list[int], rng: np.random.Generator, sigma: float = SIGMA
) -> Observations:
    return noisy_bearings(pose, landmarks[names], np.array(names, dtype=np.int64), rng, sigma)


def started(settings: Delayed, correction: Correction = "standard") -> BearingFilter:
    return BearingFilter(np.zeros(3), np.zeros((3, 3)), correction, settings)


# --- Jacobians -----------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", [0.3, math.pi, -math.pi])
def test_the_jacobians_of_bearings_near_clones(heading: float) -> None:
    """Residuals are measurement minus prediction, hence the sign."""
    clones = np.array([[0.0, 0.0, heading], [1.0, -0.5, 1.0], [6.0, 4.5, -2.0]])
    increments = np.array([[0.0, 0.0, 0.0], [0.4, 0.1, -0.2], [0.3, -0.2, 1.0]])
    landmark, noise = np.array([3.0, 4.0]), np.array([0.1, -0.2, 0.05])
    poses = compose(clones, increments)
    offset = landmark - poses[:, :2]
    bearings = np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2] + noise
    residual, *jacobians = linearise_bearings(poses, clones, bearings, landmark)
    np.testing.assert_allclose(residual, noise, rtol=0, atol=1e-12)

    def expected(unknowns: Float) -> Float:
        clones, increments = unknowns[:18].reshape(2, 3, 3)
        return -linearise_bearings(compose(clones, increments), clones, bearings, unknowns[18:])[0]

    at = np.concatenate([clones.ravel(), increments.ravel(), landmark])
    rows = [block_diag(*of_pose) for of_pose in jacobians[:2]]
    assert_jacobian(expected, np.column_stack([*rows, jacobians[2]]), at)


# --- placement -----------------------------------------------------------------------------------


class Twin:
    """Robot, clones and landmarks on full matrices; a placement in information form."""

    def __init__(self, mean: Float, cov: Float, sure: float) -> None:
        self.x, self.P, self.sure = mean.copy(), cov.copy(), sure
        self.clones: list[int] = []  # first state entry of each, in the order of time
        self.sights: list[float] = []

    def predict(self, increment: Float) -> None:
        self.x, self.P, _ = textbook.predict(textbook.Belief(self.x, self.P, ()), increment, Q)

    def see(self, z: float) -> bool:
        """Clone the robot; place the landmark if its bearings are sufficient; return whether it is placed."""
        self.clones.append(len(self.x))
        self.sights.append(z)
        T = np.vstack([np.eye(len(self.x)), np.eye(3, len(self.x))])
        self.x, self.P = T @ self.x, T @ self.P @ T.T
        if len(self.sights) < FEWEST:
            return False
        columns = np.concatenate([np.arange(first, first + 3) for first in self.clones])
        poses = self.x[columns].reshape(-1, 3)
        found = triangulate(poses, np.array(self.sights), np.full(len(poses), SIGMA**2), self.sure)
        if found.placed:
            self.condition(columns, poses, found.landmark)
        return found.placed

    def condition(self, columns: Int, poses: Float, landmark: Float) -> None:
        """Compute the posterior of state and landmark with a flat prior on the landmark.

        P is singular because the robot equals the newest clone: the information form omits the robot, which is added
        again afterwards.
        """
        size = len(self.x)
        kept = np.arange(3, size)  # without the robot, a copy of the newest clone
        columns = columns - 3
        H, r = np.zeros((len(poses), size - 3 + 2)), np.zeros(len(poses))
        for row, pose in enumerate(poses):
            offset = landmark - pose[:2]
            across = J @ offset / (offset @ offset)
            H[row, columns[3 * row : 3 * row + 3]] = [*-across, -1.0]
            H[row, -2:] = across
            r[row] = wrap(self.sights[row] - (np.arctan2(offset[1], offset[0]) - pose[2]))
        information = np.zeros((size - 1, size - 1))
        information[:-2, :-2] = np.linalg.inv(self.P[np.ix_(kept, kept)])
        information += H.T @ H / SIGMA**2
        P = np.linalg.inv(information)
        x = np.concatenate([self.x[kept], landmark]) + P @ H.T @ r / SIGMA**2
        newest = self.clones[-1] - 3
        T = np.zeros((5, size - 1))  # robot and landmark remain when no landmark waits
        T[:3, newest : newest + 3] = np.eye(3)
        T[3:, -2:] = np.eye(2)
        self.x, self.P = T @ x, T @ P @ T.T
        self.x[2] = wrap(self.x[2])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("correction", ["standard", "first-estimates", "observability-constrained", "iterated"])
def test_a_placement_is_exact_conditioning(correction: Correction, seed: int) -> None:
    """Filter and reference have the same mean and the same whole covariance, before and after the placement."""
    rng = np.random.default_rng(seed)
    mean, cov = np.array([0.3, -0.2, 3.0]), np.diag([0.02, 0.03, 0.02]) ** 2
    slam, twin = BearingFilter(mean, cov, correction, Delayed(spacing=0.0, poses=60)), Twin(mean, cov, 0.1)
    truth = mean + np.sqrt(np.diag(cov)) * rng.normal(size=3)
    landmarks = (truth[:2] + rotation(truth[2]) @ np.array([3.0, 2.0]))[None]
    steps = 0
    while steps < 60 and not len(slam.landmark_ids):
        if steps:
            increment = np.array([0.15, 0.0, 0.03])
            truth = compose(truth, increment)
            measured = increment + np.sqrt(np.diag(Q)) * rng.normal(size=3)
            slam.predict(measured, Q)
            twin.predict(measured)
        steps += 1
        scan = sights(truth, landmarks, [0], rng)
        slam.update(scan)
        placed = twin.see(float(scan.value[0, 0]))
        assert (0 in slam.landmark_ids) == placed
        np.testing.assert_allclose(slam.pose, twin.x[:3], rtol=0, atol=1e-11)
        P = slam.cov
        if not placed:
            entries = np.array([0, 1, 2, *(3 + 4 * c + i for c in range(steps) for i in range(3))])
            assert len(P) == 3 + 4 * steps
            np.testing.assert_array_equal(np.delete(P, entries, axis=0), 0.0)  # the unused entry of a clone's slot
            P = P[np.ix_(entries, entries)]
        np.testing.assert_allclose(P, twin.P, rtol=0, atol=1e-11)
        if placed:
            np.testing.assert_allclose(slam.landmarks[0], twin.x[3:], rtol=0, atol=1e-10)
            np.testing.assert_allclose(slam.landmark_covs[0], twin.P[3:, 3:], rtol=0, atol=1e-11)
    assert steps > 5
    assert 0 in slam.landmark_ids


def test_bearings_of_two_landmarks_with_one_id_are_never_placed() -> None:
    """A third landmark is placed as if they did not exist."""
    rng = np.random.default_rng(3)
    slam, sound, pose = started(Delayed(poses=12)), started(Delayed(poses=12)), np.zeros(3)
    landmarks = np.array([[3.0, 3.0], [2.0, 4.5], [4.0, -2.0]])
    for k in range(30):
        if k:
            pose = compose(pose, [0.25, 0.0, 0.0])
            for each in (slam, sound):
                each.predict([0.25, 0.0, 0.0], Q)
        seen = sights(pose, landmarks, [k % 2, 2], rng)
        slam.update(Observations(np.array([0, 2]), seen.value, seen.cov))
        sound.update(Observations(np.array([2]), seen.value[1:], seen.cov[1:]))
    assert slam.landmark_ids.tolist() == [2]
    offset = slam.landmarks[0] - landmarks[2]
    assert offset @ np.linalg.solve(slam.landmark_covs[0], offset) < 13.8  # chi-square, 2 dof, 1 in 1000
    np.testing.assert_allclose(slam.landmarks, sound.landmarks, rtol=0, atol=1e-9)
    assert 0.0 < IMPROBABLE < 0.05


@pytest.mark.parametrize(("factor", "placed"), [(0.95, True), (1.05, False)])
def test_a_landmark_waits_if_the_chi_square_of_its_bearings_is_improbable(factor: float, placed: bool) -> None:
    """The path is exact, and the fewest bearings deviate in turn to the left and right."""
    sigma, distances = 1e-3, np.linspace(0.0, 3.0, FEWEST)
    offsets = np.column_stack([1.5 - distances, np.full(FEWEST, 4.0)])
    gradient = offsets @ J.T / np.sum(offsets**2, axis=1, keepdims=True)
    deviation = (-1.0) ** np.arange(FEWEST)
    rest = deviation - gradient @ np.linalg.lstsq(gradient, deviation)[0]
    deviation *= sigma * math.sqrt(factor * chi2.isf(IMPROBABLE, FEWEST - 2) / (rest @ rest))
    slam = started(Delayed(poses=60, spacing=0.0))
    for k in range(FEWEST):
        if k:
            slam.predict([distances[1], 0.0, 0.0], np.zeros((3, 3)))
        bearing = math.atan2(offsets[k, 1], offsets[k, 0]) + deviation[k]
        slam.update(Observations(np.array([0]), np.array([[bearing]]), np.array([[[sigma**2]]])))
    assert (0 in slam.landmark_ids) == placed


# --- the window ----------------------------------------------------------------------------------


def clones_in(slam: BearingFilter) -> int:
    """Return the number of cloned poses in the state."""
    return (len(slam.cov) - 3 - 2 * len(slam.landmark_ids)) // 4


@CORRECTIONS
def test_covariances_stay_semidefinite_and_the_window_bounded(correction: Correction) -> None:
    """A loop among landmarks that are observed with probability 0.7; at the end no landmark waits.

    The hidden ids of clones are used once.
    """
    rng = np.random.default_rng(5)
    angles = rng.uniform(-np.pi, np.pi, 25)
    landmarks = rng.uniform(6.5, 9.0, (25, 1)) * np.column_stack([np.cos(angles), np.sin(angles)]) + [0.0, 5.0]
    slam, pose = started(Delayed(poses=10, spacing=0.2), correction), np.zeros(3)
    largest, steps, retired, before = 0, 220, set[int](), set[int]()
    for k in range(steps):
        if k:
            increment = np.array([0.3, 0.0, 0.06])
            pose = compose(pose, increment)
            slam.predict(increment + np.sqrt(np.diag(Q)) * rng.normal(size=3), Q)
        near = np.hypot(*(landmarks - pose[:2]).T) < 6.0
        slam.update(sights(pose, landmarks, np.flatnonzero(near & (rng.random(25) < 0.7)).tolist(), rng))
        largest, ids = max(largest, clones_in(slam)), slam.map.ids.tolist()
        retired |= before - {*ids}
        before = {*ids}
        assert len(before) == len(ids)
        assert not retired & before
        P = slam.cov
        np.testing.assert_array_equal(P, P.T)
        assert np.linalg.eigvalsh(P)[0] >= -1e-12 * np.trace(P)
        assert len(P) == 3 + 2 * len(slam.landmark_ids) + 4 * clones_in(slam)
    assert largest == 10
    assert len(retired) > 50
    assert len(slam.landmark_ids) == 25
    assert len(slam.cov) == 3 + 2 * 25
    if correction in ("standard", "right-invariant"):
        error = np.array([*(slam.pose - pose)[:2], wrap(slam.pose[2] - pose[2])])
        assert error @ np.linalg.solve(slam.pose_cov, error) < 21.1  # chi-square, 3 dof, 1 in 10 000


def test_a_long_path_is_mapped_to_its_end() -> None:
    """Landmarks that were never placed do not fill the window.

    A window that always removed the clone nearest to its neighbours ended with clones spread over the whole path, used
    by landmarks that are never re-observed, and placed nothing more.
    """
    rng = np.random.default_rng(7)
    landmarks = np.column_stack([rng.uniform(0.0, 200.0, 200), rng.uniform(1.0, 10.0, 200) * rng.choice([-1, 1], 200)])
    slam, pose = started(Delayed(poses=15, spacing=0.4)), np.zeros(3)
    seen: set[int] = set()
    for k in range(900):
        if k:
            pose = compose(pose, [0.2, 0.0, 0.0])
            slam.predict([0.2, 0.0, 0.0], np.diag([1e-4, 1e-4, 1e-5]) ** 2)
        names = np.flatnonzero(np.hypot(*(landmarks - pose[:2]).T) < 10.0).tolist()
        seen |= {*names}
        slam.update(sights(pose, landmarks, names, rng, sigma=np.deg2rad(5.0)))
        assert clones_in(slam) <= 15
        assert len(slam.provisional) <= 80
    bins = np.histogram(landmarks[slam.landmark_ids, 0], bins=9, range=(0.0, 180.0))[0]
    there = np.histogram(landmarks[[*seen], 0], bins=9, range=(0.0, 180.0))[0]
    assert (bins > 0.5 * there).all()


def test_the_oldest_pose_that_no_landmark_in_view_uses_is_removed_first() -> None:
    """Each landmark is observed once, and waits until its pose is removed."""
    slam = started(Delayed(poses=8, spacing=0.2))
    for k in range(20):
        slam.predict([0.3, 0.0, 0.0], Q)
        slam.update(Observations(np.array([k]), np.array([[1.5]]), np.array([[[SIGMA**2]]])))
    assert [*slam.provisional] == [*range(12, 20)]


def test_a_standing_robot_adds_no_poses() -> None:
    rng = np.random.default_rng(8)
    slam = started(Delayed(spacing=0.2))
    landmarks = np.array([[3.0, 3.0], [2.0, 4.5]])
    for k in range(20):
        slam.update(sights(np.zeros(3), landmarks, [0, 1] if k else [0], rng))
        assert clones_in(slam) == 1
        slam.predict([0.0, 0.0, 0.1], Q)  # a turn without translation adds no pose either
    assert slam.provisional == {0: 0}
    slam.predict([0.21, 0.0, 0.0], Q)
    slam.update(sights(np.array([0.2, 0.0, 0.0]), landmarks, [0, 1], rng))
    assert clones_in(slam) == 2
    assert slam.provisional == {0: 0, 1: 0}
