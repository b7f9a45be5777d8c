"""Association of bearings with rays and points, compared with brute force."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float, Int
from slamgauge.ekf import Association, MapManagement
from slamgauge.ekf.bearings.ray_association import RayAssociation
from slamgauge.ekf.kernels.individual_compatibility import NONE
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import replace_map
from slamgauge.se2 import wrap
from tests.reference.textbook_association import Scan, brute_force_ambiguous, brute_force_joint

pytestmark = pytest.mark.slow

METHODS = pytest.mark.parametrize("method", ["nearest-neighbour", "jcbb"])
J = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class Problem:
    """A scan and landmarks that are points or rays, slots in random order."""

    map: LandmarkMap
    owners: Int  # (L,) landmark of each slot
    values: Float  # (m, 1)
    covs: Float  # (m, 1, 1)
    innovation: Float  # (m, L)
    jacobian: Float  # (L, n)
    P: Float

    def distances(self) -> Float:
        """Return d^2 (m, L) of bearings and slots."""
        predicted = np.einsum("li,ij,lj->l", self.jacobian, self.P, self.jacobian)
        return self.innovation**2 / (predicted + self.covs[:, 0])

    def of_rays(self) -> Scan:
        """Return the scan with one column per landmark: its member nearest to the bearing."""
        landmarks, distances = int(self.owners.max()) + 1, self.distances()
        m, n = len(self.values), len(self.P)
        innovation, jacobian = np.zeros((m, landmarks, 2)), np.zeros((m, landmarks, 2, n))
        for i in range(m):
            for landmark in range(landmarks):
                slots = np.flatnonzero(self.owners == landmark)
                slot = slots[np.argmin(distances[i, slots])]
                innovation[i, landmark, 1] = self.innovation[i, slot]
                jacobian[i, landmark, 1] = self.jacobian[slot]
        R = np.tile(np.eye(2), (m, 1, 1))
        R[:, 1, 1] = self.covs[:, 0, 0]
        return Scan(innovation, jacobian, self.P, R)


def random_problem(seed: int) -> Problem:
    """Return landmarks so close together that bearings have several candidates, and some clutter."""
    rng = np.random.default_rng(seed)
    owners = np.concatenate([[landmark] * int(rng.integers(1, 4)) for landmark in range(int(rng.integers(2, 5)))])
    angles = rng.uniform(-0.6, 0.6, int(owners.max()) + 1)[owners] + 0.03 * rng.normal(size=len(owners))
    ranges = rng.uniform(2.0, 8.0, len(owners))
    order = rng.permutation(len(owners))
    owners, angles, ranges = owners[order], angles[order], ranges[order]
    n = 3 + 2 * len(owners)
    root = 0.12 * rng.normal(size=(n, n)) / np.sqrt(n)
    root[3:] *= 2.0
    P, pose = root @ root.T, np.array([0.4, -0.3, 3.0])
    landmarks = pose[:2] + ranges[:, None] * np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    landmark_map = LandmarkMap("bearing", pose, P[:3, :3], "standard", landmarks=0)
    replace_map(landmark_map, np.arange(len(owners)) * 3, landmarks, P)
    seen = rng.permutation(len(owners))[: int(rng.integers(1, 5))]
    values = wrap(np.concatenate([angles[seen] + 0.06 * rng.normal(size=len(seen)), rng.uniform(-1, 1, 1)]))
    covs = rng.uniform(0.03, 0.06, len(values)) ** 2
    jacobian = np.zeros((len(owners), n))
    for slot, landmark in enumerate(landmarks):
        offset = landmark - pose[:2]
        across = J @ offset / (offset @ offset)
        jacobian[slot, :2], jacobian[slot, 2], jacobian[slot, 3 + 2 * slot : 5 + 2 * slot] = -across, -1.0, across
    innovation = wrap(values[:, None] - angles)
    return Problem(landmark_map, owners, values[:, None], covs[:, None, None], innovation, jacobian, P)


def named(problem: Problem, settings: Association) -> tuple[list[int], int]:
    """Return the ids of the bearings, and the number of landmarks, which a first scan has mapped."""
    landmarks, after = int(problem.owners.max()) + 1, problem.map
    before = LandmarkMap("bearing", after.state.pose, after.state.pose_cov, "standard", landmarks=0)
    association = RayAssociation(before, settings)
    first = association.associate(np.zeros(0, np.int64), np.zeros((landmarks, 1)), np.full((landmarks, 1, 1), 1e-3))
    assert first.tolist() == [*range(landmarks)]
    replace_map(before, after.state.ids, after.state.positions, after.state.cov)
    names = association.associate(problem.owners, problem.values, problem.covs).tolist()
    claimed = [name for name in names if name != NONE]
    assert len({*claimed}) == len(claimed)  # one bearing, one landmark
    fresh = [name for name in claimed if name >= landmarks]
    assert fresh == [*range(landmarks, landmarks + len(fresh))]
    return names, landmarks


def greedy(distances: Float, gate: float) -> dict[int, int]:
    """Return the landmark of each bearing: the nearest pair, then the nearest among the free ones, and so on."""
    found: dict[int, int] = {}
    while True:
        free = distances.copy()
        free[[*found]] = np.inf
        free[:, [*found.values()]] = np.inf
        i, landmark = np.unravel_index(np.argmin(free), free.shape)
        if free[i, landmark] > gate:
            return found
        found[int(i)] = int(landmark)


def quantiles_of(gate: float, most: int) -> Float:
    return np.concatenate([[0.0], chi2.isf(chi2.sf(gate, 1), np.arange(1, most + 1))])


@pytest.mark.parametrize("gate", [1.0, 9.0])
def test_nearest_neighbours_equal_brute_force(gate: float) -> None:
    claimed, contested = 0, 0
    for seed in range(200):
        problem = random_problem(seed)
        names, landmarks = named(problem, Association(gate=gate))
        distances = problem.of_rays().distances()
        expected = greedy(distances, gate)
        assert {i: name for i, name in enumerate(names) if name < landmarks} == expected
        assert NONE not in names
        claimed += len(expected)
        contested += any(np.argmin(distances[i]) != landmark for i, landmark in expected.items())
    assert claimed > 150
    assert contested > 5


@pytest.mark.parametrize("gate", [2.0, 9.0])
def test_joint_association_equals_brute_force(gate: float) -> None:
    """Among all assignments: the most pairs, then the smallest joint distance."""
    outcomes = {"several": 0, "not the nearest": 0, "member that is not the first": 0}
    for seed in range(200):
        problem = random_problem(seed)
        names, landmarks = named(problem, Association("jcbb", gate))
        scan = problem.of_rays()
        expected = dict(brute_force_joint(scan, gate, quantiles_of(gate, len(names))))
        assert {i: name for i, name in enumerate(names) if name < landmarks} == expected
        outcomes["several"] += len(expected) > 1
        outcomes["not the nearest"] += expected != greedy(scan.distances(), gate)
        nearest = [np.argmin(problem.distances()[i]) for i in expected]
        outcomes["member that is not the first"] += any(
            (problem.owners[:s] == problem.owners[s]).any() for s in nearest
        )
    assert min(outcomes.values()) > 5, outcomes


def test_with_map_management_ambiguous_bearings_are_ignored_and_others_start_landmarks() -> None:
    gate, outcomes = 4.0, {"ambiguous": 0, "known": 0, "new": 0}
    management = MapManagement(margin=4.0)
    for seed in range(200):
        problem = random_problem(seed)
        names, landmarks = named(problem, Association("jcbb", gate, management))
        scan = problem.of_rays()
        best = brute_force_joint(scan, gate, quantiles_of(gate, len(names)))
        ambiguous = brute_force_ambiguous(scan, gate, management.margin, best)
        expected = {i: landmark for i, landmark in best if i not in ambiguous}
        assert {i: name for i, name in enumerate(names) if NONE != name < landmarks} == expected
        assert {i for i, name in enumerate(names) if name == NONE} == {*ambiguous}
        outcomes["ambiguous"] += len(ambiguous)
        outcomes["known"] += len(expected)
        outcomes["new"] += len(names) - len(expected) - len(ambiguous)
    assert min(outcomes.values()) > 5, outcomes


def test_an_empty_scan_has_no_ids() -> None:
    problem = random_problem(0)
    nothing = replace(problem, values=problem.values[:0], covs=problem.covs[:0])
    assert named(nothing, Association("jcbb", map_management=MapManagement()))[0] == []
