"""Association of bearings with rays and points: against brute force scan by scan, and what filters make of it."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2
from textbook_association import Scan, brute_force_ambiguous, brute_force_joint

from slamgauge.arrays import Float, Int
from slamgauge.ekf import Association, BearingFilter, MapManagement, Rays, ekf
from slamgauge.ekf.bearings.ray_association import RayAssociation
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.kernels.compatibility import NONE
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.rules import CORRECTIONS, RULES, Correction
from slamgauge.ekf.settings.association import Method
from slamgauge.errors import UserError
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import chain, wrap

METHODS = pytest.mark.parametrize("method", ["nearest-neighbour", "jcbb"])
J = np.array([[0.0, -1.0], [1.0, 0.0]])


# --- scan by scan --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """A scan before landmarks that are points or rays of some members, slots in random order."""

    map: LandmarkMap
    owners: Int  # (L,) landmark of each slot
    values: Float  # (m, 1)
    covs: Float  # (m, 1, 1)
    innovation: Float  # (m, L)
    jacobian: Float  # (L, n)
    P: Float

    def distances(self) -> Float:
        """d^2 (m, L) of bearings and slots."""
        predicted = np.einsum("li,ij,lj->l", self.jacobian, self.P, self.jacobian)
        return self.innovation**2 / (predicted + self.covs[:, 0])

    def of_rays(self) -> Scan:
        """The scan with one column per landmark, each standing for its member nearest to the bearing."""
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
    """Landmarks near enough to each other that bearings have several candidates; some bearings are of nothing."""
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
    landmark_map.replace(np.arange(len(owners)) * 3, landmarks, P)
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
    """Names of the bearings, and how many landmarks there were before; those are given their names by a first scan."""
    landmarks, after = int(problem.owners.max()) + 1, problem.map
    before = LandmarkMap("bearing", after.pose, after.pose_cov, "standard", landmarks=0)
    association = RayAssociation(before, settings)
    first = association.associate(np.zeros(0, np.int64), np.zeros((landmarks, 1)), np.full((landmarks, 1, 1), 1e-3))
    assert first.tolist() == [*range(landmarks)]
    before.replace(after.ids, after.positions, after.cov)
    names = association.associate(problem.owners, problem.values, problem.covs).tolist()
    claimed = [name for name in names if name != NONE]
    assert len({*claimed}) == len(claimed)  # one bearing, one landmark
    fresh = [name for name in claimed if name >= landmarks]
    assert fresh == [*range(landmarks, landmarks + len(fresh))]
    return names, landmarks


def greedy(distances: Float, gate: float) -> dict[int, int]:
    """Landmark of each bearing: the nearest pair of all, then the nearest of what is free, and so on."""
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
def test_nearest_neighbours_are_those_of_brute_force(gate: float) -> None:
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
def test_joint_association_is_that_of_brute_force(gate: float) -> None:
    """Over every assignment of bearings to landmarks: most pairs first, then the smallest joint distance."""
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


def test_what_is_ambiguous_is_left_out() -> None:
    """With map management `jcbb` gives no bearing away that may be another's; what has no landmark begins one."""
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


def test_a_scan_of_nothing_has_no_names() -> None:
    problem = random_problem(0)
    nothing = replace(problem, values=problem.values[:0], covs=problem.covs[:0])
    assert named(nothing, Association("jcbb", map_management=MapManagement()))[0] == []


# --- whole runs ----------------------------------------------------------------------------------


def sparse_world(seed: int, steps: int = 220) -> tuple[Recording, Int]:
    """One loop inside ten landmarks 36 degrees apart, the five nearest in view, and their ids.

    Bearings are twice as good as the recording says, so that none of the thousand fails a gate of three deviations.
    """
    sigma = np.deg2rad(0.5)
    rng = np.random.default_rng(seed)
    increments = np.tile([0.15, 0.0, 2 * np.pi / 200], (steps, 1))
    poses = chain(np.zeros(3), increments)
    angles = np.arange(10) * 2 * np.pi / 10
    landmarks = np.array([0.0, 4.8]) + 8.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    offset = landmarks - poses[:, None, :2]
    near = np.argsort(np.hypot(offset[..., 0], offset[..., 1]), axis=1)[:, :5]
    step, landmark = np.repeat(np.arange(steps + 1), 5), near.ravel()
    exact = np.arctan2(offset[step, landmark, 1], offset[step, landmark, 0]) - poses[step, 2]
    motion_cov = np.diag([0.003, 0.001, 0.001]) ** 2
    recording = Recording(
        stamps=np.arange(steps + 1.0),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([0.01, 0.01, 0.002]) ** 2,
        odometry=increments + rng.multivariate_normal(np.zeros(3), motion_cov, steps),
        odometry_cov=np.tile(motion_cov, (steps, 1, 1)),
        sensor="bearing",
        observation_step=step,
        observation=wrap(exact + sigma / 2 * rng.normal(size=len(exact)))[:, None],
        observation_cov=np.full((len(exact), 1, 1), sigma**2),
        landmark=landmark,
    )
    return recording, landmark


@METHODS
@pytest.mark.parametrize("correction", ["ekf", "riekf"])
@pytest.mark.parametrize("managed", [False, True])
def test_landmarks_far_apart_are_told_apart(method: Method, correction: str, managed: bool) -> None:
    """From ray to point and once around: the filter is then the one that was given the ids, number for number.

    Directions that are not known well are not too vague here.
    """
    recording, truth = sparse_world(0)
    settings = Association(method, map_management=MapManagement(margin=0.0, vagueness=1e9) if managed else None)
    start = (recording.prior_mean, recording.prior_cov, CORRECTIONS[correction])
    by_itself, told = BearingFilter(*start, association=settings), BearingFilter(*start)
    given: list[Int] = []
    for _, _ in zip(drive(by_itself, replace(recording, landmark=None)), drive(told, recording), strict=True):
        given.append(by_itself.associated)
        np.testing.assert_allclose(by_itself.pose, told.pose, rtol=0, atol=1e-12)
    names = np.concatenate(given)
    pairs = {*zip(names.tolist(), truth.tolist(), strict=True)}
    assert sorted(name for name, _ in pairs) == sorted(name for _, name in pairs) == [*range(10)]
    assert not by_itself.provisional
    np.testing.assert_allclose(by_itself.cov, told.cov, rtol=0, atol=1e-12)
    np.testing.assert_allclose(by_itself.landmarks, told.landmarks, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(by_itself.standing(names), names)


@pytest.mark.parametrize("correction", ["ekf", "riekf"])
def test_what_comes_back_into_view_is_joined_with_what_it_is(correction: str) -> None:
    """Whose direction is too vague to tell it by a bearing begins a ray, and is known again as a point."""
    recording, truth = sparse_world(0, steps=400)
    settings = Association("jcbb", map_management=MapManagement(vagueness=0.1))
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, CORRECTIONS[correction], association=settings)
    names = np.concatenate([slam.associated for _ in drive(slam, replace(recording, landmark=None))])
    standing = slam.standing(names)
    assert (names != standing).any()
    found = standing != NONE
    pairs = {*zip(standing[found].tolist(), truth[found].tolist(), strict=True)}
    assert len(pairs) == len({name for name, _ in pairs}) == len(slam.landmark_ids)  # one landmark each
    assert {landmark for _, landmark in pairs} == {*range(10)}


def see(slam: BearingFilter, *bearings: float) -> list[int]:
    values = np.array(bearings)[:, None]
    slam.update(Observations(None, values, np.full((len(values), 1, 1), 1e-4)))
    return slam.associated.tolist()


def test_an_update_that_is_refused_at_its_end_leaves_names_and_map_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After rays were given up, and points joined."""
    recording, _ = sparse_world(0, steps=300)
    settings = Association("jcbb", map_management=MapManagement(vagueness=0.1))
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, association=settings)
    tidy, changed = getattr(BearingFilter, "_tidy"), 0  # noqa: B009
    books = vars(slam)["_association"]

    def state() -> tuple[object, ...]:
        kept = {name: each for name, each in vars(books).items() if isinstance(each, (list, set, dict))}
        return copy.deepcopy(kept), books.clock.now, slam.provisional, slam.landmark_ids.tolist(), slam.cov.tolist()

    def refuse(slam: BearingFilter, association: RayAssociation) -> None:
        tidy(slam, association)
        raise UserError("refused")

    for step in range(recording.steps + 1):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        rows = recording.observation_step == step
        scan = Observations(None, recording.observation[rows], recording.observation_cov[rows])
        if step % 4 == 0 or step > 280:
            before = state()
            with monkeypatch.context() as patch:
                patch.setattr(BearingFilter, "_tidy", refuse)
                with pytest.raises(UserError, match="refused"):
                    slam.update(scan)
            assert state() == before
        survivors = len(vars(books)["_survivors"])
        slam.update(scan)
        changed += len(vars(books)["_survivors"]) > survivors and (step % 4 == 0 or step > 280)
    assert changed > 0


def walk(slam: BearingFilter) -> None:
    """A step on the spot."""
    slam.predict(np.zeros(3), np.zeros((3, 3)))


@METHODS
@pytest.mark.parametrize("rays", [Rays(), Rays(s_min=9.0)], ids=["rays", "points at the second sight"])
def test_false_starts_are_deleted(method: Method, rays: Rays) -> None:
    """Seen twice and never again: gone after probation, members and all, whether it is a ray still or a point."""
    management = MapManagement(sights=3, probation=5)
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), "standard", rays, Association(method, 9.0, management))
    assert see(slam, 0.0, 1.0) == [0, 1]
    assert see(slam, 0.0, 1.0) == [0, 1]
    assert slam.landmark_ids.tolist() == []
    for scan in (3, 4):
        assert see(slam, 0.0) == [0]
        assert slam.landmark_ids.tolist() == [0]
        assert slam.standing(np.array([0, 1, NONE])).tolist() == [0, NONE, NONE]
        assert len(slam.cov) == 3 + 2 * (8 if len(slam.provisional) else 2), scan
    assert see(slam, 0.0) == [0]
    assert len(slam.cov) == 3 + 2 * (4 if len(slam.provisional) else 1)
    assert {*slam.provisional, *slam.landmark_ids.tolist()} == {0}
    assert see(slam, 0.0, 1.0) == [0, 2]  # a name is not given again
    assert slam.standing(np.array([0, 1, 2, NONE])).tolist() == [0, NONE, NONE, NONE]


@METHODS
def test_a_ray_that_is_not_seen_for_long_is_given_up(method: Method) -> None:
    """It was confirmed, but lies in the direction of whatever comes there next."""
    management = MapManagement(sights=3, probation=5)
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), "standard", Rays(), Association(method, 9.0, management))
    for _ in range(3):
        walk(slam)
        assert see(slam, 0.0, 1.0) == [0, 1]
    for _ in range(5):
        assert {*slam.provisional} == {0, 1}
        walk(slam)
        assert see(slam, 0.0) == [0]
    walk(slam)
    assert see(slam, 0.0) == [0]
    assert {*slam.provisional} == {0}
    assert slam.standing(np.array([0, 1])).tolist() == [0, NONE]
    assert len(slam.cov) == 3 + 2 * slam.member_count
    walk(slam)
    assert see(slam, 1.0) == [2]


def test_without_management_everything_stands() -> None:
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), association=Association())
    assert see(slam, 0.0, 1.0) == [0, 1]
    for _ in range(20):
        assert see(slam, 0.0) == [0]
    assert slam.landmark_ids.tolist() == [0, 1]


@METHODS
@pytest.mark.parametrize("correction", RULES)
@pytest.mark.parametrize(("field", "bad"), [("value", np.nan), ("cov", np.inf), ("cov", 0.0), ("cov", -1.0)])
def test_what_is_not_sound_is_refused_and_changes_nothing(
    method: Method, correction: Correction, field: str, bad: float
) -> None:
    settings = Association(method, map_management=MapManagement())
    slam, other = (BearingFilter(np.zeros(3), 1e-4 * np.eye(3), correction, association=settings) for _ in range(2))
    for each in (slam, other):
        see(each, 0.0, 1.0)
    observations = Observations(None, np.array([[0.0], [2.0]]), np.full((2, 1, 1), 1e-4))
    getattr(observations, field)[1] = bad
    name = "observation_cov" if field == "cov" else "observation"
    with pytest.raises(ValueError, match=rf"^{name}\[1\] = [^\n]*: [^\n]*$"):
        slam.update(observations)
    np.testing.assert_array_equal(slam.associated, other.associated)
    for each in (slam, other):
        each.predict([0.1, 0.0, 0.0], 1e-6 * np.eye(3))
        assert see(each, 0.0, 2.0) == [0, 2]
    np.testing.assert_array_equal(slam.cov, other.cov)


def test_an_estimate_says_what_stands_at_the_end() -> None:
    recording, truth = sparse_world(1, steps=60)
    clutter = np.arange(0, len(truth), 97)
    values = recording.observation.copy()
    values[clutter] = wrap(values[clutter] + 0.3)
    nameless = replace(recording, landmark=None, observation=values)
    settings = Association("jcbb", map_management=MapManagement(sights=4, probation=6, margin=0.0))
    estimate = ekf(nameless, association=settings)
    assert estimate.association is not None
    assert (estimate.association[clutter] == NONE).all()
    kept = np.delete(np.arange(len(truth)), clutter)
    pairs = {*zip(estimate.association[kept].tolist(), truth[kept].tolist(), strict=True)} - {(NONE, t) for t in truth}
    assert len({name for name, _ in pairs}) == len({true for _, true in pairs}) == len(pairs)
    assert {name for name, _ in pairs} == {*np.asarray(estimate.landmark_ids).tolist()}
