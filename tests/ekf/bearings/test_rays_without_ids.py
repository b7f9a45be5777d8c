"""Runs of bearings without ids: rays become points, duplicates are merged, failed tracks deleted."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Int
from slamgauge.ekf import Association, BearingFilter, FilterSettings, MapManagement, Rays, ekf_slam
from slamgauge.ekf.bearings.ray_association import RayAssociation
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.kernels.individual_compatibility import NONE
from slamgauge.ekf.maps.correction_table import CORRECTIONS, RULES, Correction
from slamgauge.ekf.settings import Method
from slamgauge.errors import UserError
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import chain, wrap

pytestmark = pytest.mark.slow

METHODS = pytest.mark.parametrize("method", ["nearest-neighbour", "jcbb"])


def sparse_world(seed: int, steps: int = 220) -> tuple[Recording, Int]:
    """Return a loop inside ten landmarks 36 degrees apart, the five nearest in view, and the ids.

    The noise of bearings is half of that in the recording, so that all of the thousand pass a gate of three deviations.
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
def test_with_landmarks_far_apart_the_filter_equals_one_with_ids(
    method: Method, correction: str, managed: bool
) -> None:
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
def test_landmarks_that_come_back_into_view_are_merged_with_their_old_points(correction: str) -> None:
    """Their direction is too uncertain for an association, so that they start a second ray."""
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


def test_an_update_refused_after_deletions_and_merges_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, _ = sparse_world(0, steps=300)
    settings = Association("jcbb", map_management=MapManagement(vagueness=0.1))
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, association=settings)
    manage, undone = getattr(BearingFilter, "_manage"), 0  # noqa: B009
    parts = vars(slam)["_association"]

    def state() -> list[object]:
        arrays = [each.tolist() for each in vars(parts).values() if isinstance(each, np.ndarray)]
        apart = copy.deepcopy(vars(parts)["_apart"])
        return [arrays, apart, parts.clock.now, slam.provisional, slam.landmark_ids.tolist(), slam.cov.tolist()]

    def refuse(slam: BearingFilter, association: RayAssociation) -> None:
        manage(slam, association)
        raise UserError("refused")

    for step in range(recording.steps + 1):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        rows = recording.observation_step == step
        scan = Observations(None, recording.observation[rows], recording.observation_cov[rows])
        is_tried = step % 4 == 0 or step > 280
        if is_tried:
            before = state()
            with monkeypatch.context() as patch:
                patch.setattr(BearingFilter, "_manage", refuse)
                with pytest.raises(UserError, match="refused"):
                    slam.update(scan)
            assert state() == before
        landmarks = len(slam.landmark_ids)
        slam.update(scan)
        undone += is_tried and len(slam.landmark_ids) < landmarks
    assert undone > 0


def walk(slam: BearingFilter) -> None:
    """Make a step without motion."""
    slam.predict(np.zeros(3), np.zeros((3, 3)))


@METHODS
@pytest.mark.parametrize("rays", [Rays(0.3, 2.0, 1.0), Rays(s_min=9.0)], ids=["rays", "points at once"])
def test_rays_and_points_that_fail_probation_are_deleted(method: Method, rays: Rays) -> None:
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
    assert see(slam, 0.0, 1.0) == [0, 2]  # an id is not used again
    assert slam.standing(np.array([0, 1, 2, NONE])).tolist() == [0, NONE, NONE, NONE]


@METHODS
def test_a_confirmed_ray_without_recent_observations_is_deleted(method: Method) -> None:
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


def test_without_map_management_nothing_is_deleted() -> None:
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), association=Association())
    assert see(slam, 0.0, 1.0) == [0, 1]
    for _ in range(20):
        assert see(slam, 0.0) == [0]
    assert slam.landmark_ids.tolist() == [0, 1]


@METHODS
@pytest.mark.parametrize("correction", RULES)
@pytest.mark.parametrize(("field", "bad"), [("value", np.nan), ("cov", np.inf), ("cov", 0.0), ("cov", -1.0)])
def test_invalid_bearings_are_refused_and_change_nothing(
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


def test_an_estimate_has_the_ids_that_remain_at_the_end() -> None:
    recording, truth = sparse_world(1, steps=60)
    clutter = np.arange(0, len(truth), 97)
    values = recording.observation.copy()
    values[clutter] = wrap(values[clutter] + 0.3)
    nameless = replace(recording, landmark=None, observation=values)
    settings = Association("jcbb", map_management=MapManagement(sights=4, probation=6, margin=0.0))
    estimate = ekf_slam(nameless, FilterSettings(settings))
    assert estimate.association is not None
    assert (estimate.association[clutter] == NONE).all()
    kept = np.delete(np.arange(len(truth)), clutter)
    pairs = {*zip(estimate.association[kept].tolist(), truth[kept].tolist(), strict=True)} - {(NONE, t) for t in truth}
    assert len({name for name, _ in pairs}) == len({true for _, true in pairs}) == len(pairs)
    assert {name for name, _ in pairs} == {*np.asarray(estimate.landmark_ids).tolist()}
