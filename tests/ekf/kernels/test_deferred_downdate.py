"""Deferred downdates: filters with them are compared with filters without."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import BearingFilter, SlamFilter
from slamgauge.ekf.maps.correction_table import RULES
from slamgauge.ekf.maps.map_edits import merge_landmarks, remove_landmark
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.se2 import rotation

DEFERRING = pytest.mark.parametrize("correction", [name for name, rule in RULES.items() if rule.deferred_rows[1] > 0])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
LANDMARKS = 420  # scans of four landmarks are small compared with 400 mapped ones
PRIOR_COV = np.diag([0.01, 0.01, 1e-4])
STEP, STEP_COV = np.array([0.4, 0.0, 0.05]), np.diag([1e-3, 1e-4, 1e-5])
NOISE = np.diag([0.01, 0.0025])


class World:
    """A robot on a circle among landmarks."""

    def __init__(self, sensor: str) -> None:
        self.rng = np.random.default_rng(5)
        self.sensor = sensor
        self.landmarks = self.rng.uniform(-12.0, 20.0, (LANDMARKS, 2))
        self.pose = np.zeros(3)

    def moved(self) -> Float:
        """Return the odometry of a step."""
        self.pose[:2] += rotation(self.pose[2]) @ STEP[:2]
        self.pose[2] += STEP[2]
        return STEP + self.rng.multivariate_normal(np.zeros(3), STEP_COV)

    def seen(self, ids: Int) -> Observations:
        """Return noisy observations of landmarks (m,)."""
        offset = (self.landmarks[ids] - self.pose[:2]) @ rotation(self.pose[2])
        value = offset if self.sensor == "position" else np.column_stack([np.hypot(*offset.T), bearings(offset)[:, 0]])
        noise = self.rng.multivariate_normal(np.zeros(2), NOISE, len(ids))
        return Observations(ids, value + noise, np.tile(NOISE, (len(ids), 1, 1)))


def bearings(offset: Float) -> Float:
    """(m, 1) of offsets (m, 2) in the robot's frame."""
    return np.arctan2(offset[:, 1], offset[:, 0])[:, None]


def both(sensor: str, correction: str) -> tuple[SlamFilter, SlamFilter]:
    """Return a filter, and the same one without deferred downdates."""
    rule = RULES[correction]  # pyrefly: ignore[bad-index]
    start = (sensor, np.zeros(3), PRIOR_COV)
    return SlamFilter(*start, rule), SlamFilter(*start, rule._replace(deferred_rows=(1, 0)))


def is_deferred(slam: SlamFilter | BearingFilter) -> bool:
    """Return whether downdates of covariances between landmarks are deferred."""
    landmarks = slam.map if isinstance(slam, SlamFilter) else slam._map
    return bool(landmarks.state.deferred.used[0] > 0)


def assert_same(late: SlamFilter, at_once: SlamFilter, *, whole: bool) -> None:
    """Compare poses, positions and covariances to 1e-9 of a standard deviation; `whole`: all of the covariance."""
    sigmas = np.sqrt(at_once.map.state.variances)
    assert (np.abs(late.pose - at_once.pose) <= 1e-9 * sigmas[:3]).all()
    assert (np.abs(late.landmarks - at_once.landmarks).ravel() <= 1e-9 * sigmas[3:]).all()
    assert (np.abs(late.pose_cov - at_once.pose_cov) <= 1e-9 * np.outer(sigmas[:3], sigmas[:3])).all()
    of_places = sigmas[3:].reshape(-1, 2)
    apart = np.abs(late.landmark_covs - at_once.landmark_covs)
    assert (apart <= 1e-9 * of_places[:, :, None] * of_places[:, None, :]).all()
    if whole:
        assert (np.abs(late.cov - at_once.cov) <= 1e-9 * np.outer(sigmas, sigmas)).all()


@SENSORS
@DEFERRING
def test_deferred_updates_give_the_same_estimate(sensor: str, correction: str) -> None:
    """Sparse and dense scans with new landmarks, removals, gates, merging and a refused scan."""
    world, (late, at_once) = World(sensor), both(sensor, correction)
    choice, waited = np.random.default_rng(8), 0
    for slam, scan in zip((late, at_once), [world.seen(np.arange(400))] * 2, strict=True):
        slam.update(scan)
    mapped = 400
    for step in range(130):
        increment = world.moved()
        ids = choice.choice(np.setdiff1d(np.arange(mapped), [7, 399]), 25 if step % 40 == 30 else step % 5, False)
        if step % 16 == 9 and mapped < LANDMARKS:
            ids, mapped = np.append(ids, [mapped, mapped] if step % 32 == 9 else mapped), mapped + 1
        scan, gate = world.seen(ids), 9.0 if step % 3 == 0 else None
        results = []
        for slam in (late, at_once):
            slam.predict(increment, STEP_COV)
            results.append(slam.update(scan, gate=gate))
        assert results[0][1] == results[1][1]
        assert abs(results[0][0] - results[1][0]) <= 1e-9 * max(results[1][0], 1.0)
        waited += is_deferred(late)
        if step == 51:
            broken = scan._replace(value=np.full_like(scan.value, 1e155))
            for slam in (late, at_once):
                with pytest.raises(UserError, match="observation"):
                    slam.update(broken)
        if step in (70, 71):
            for slam in (late, at_once):
                remove_landmark(slam.map, int(slam.map.state.slots_of(np.array(7 if step == 70 else 399))))
        if step == 120:
            for slam in (late, at_once):
                merge_landmarks(slam.map, *slam.map.state.slots_of(np.array([11, 12])).tolist())
        assert_same(late, at_once, whole=bool(choice.random() < 0.05))
    assert waited > 80
    assert_same(late, at_once, whole=True)
    assert not is_deferred(late)


def driven(sensor: str, correction: str) -> tuple[World, SlamFilter, SlamFilter]:
    """Return both filters after six sparse scans."""
    world, (late, at_once) = World(sensor), both(sensor, correction)
    scans = [world.seen(np.arange(400))]
    increments = [np.zeros(3)]
    for k in range(6):
        increments.append(world.moved())
        scans.append(world.seen(np.array([k, k + 50])))
    for slam in (late, at_once):
        for increment, scan in zip(increments, scans, strict=True):
            slam.predict(increment, STEP_COV)
            slam.update(scan)
    assert is_deferred(late)
    return world, late, at_once


def unpickled(slam: SlamFilter) -> SlamFilter:
    return pickle.loads(pickle.dumps(slam))


@pytest.mark.parametrize("copied", [copy.deepcopy, unpickled])
def test_copies_have_their_own_deferred_rows(copied: Callable[[SlamFilter], SlamFilter]) -> None:
    world, late, at_once = driven("position", "right-invariant")
    other = copied(late)
    assert is_deferred(other)
    assert_same(other, at_once, whole=True)  # applies the rows of the copy
    assert is_deferred(late)
    scan = world.seen(np.array([3, 4]))
    for slam in (late, other, at_once):
        slam.update(scan)
    assert_same(late, at_once, whole=True)
    assert_same(other, at_once, whole=True)


@DEFERRING
def test_a_refused_scan_leaves_the_deferred_rows(correction: str) -> None:
    """To the last bit, if the innovations are the reason: two observations too precise for double precision."""
    world, late, at_once = driven("range-bearing", correction)
    before = pickle.dumps((late.map.state.belief_with_deferred, late.pose, late.pose_cov))
    exact = world.seen(np.array([5, 5]))
    for slam in (late, at_once):
        with pytest.raises(UserError, match="no update exists"):
            slam.update(exact._replace(cov=1e-24 * exact.cov))
    assert pickle.dumps((late.map.state.belief_with_deferred, late.pose, late.pose_cov)) == before
    assert_same(late, at_once, whole=True)


@DEFERRING
def test_a_refused_later_block_leaves_the_deferred_rows(correction: str) -> None:
    """41 observations are three blocks; the first applies the rows, the last two observations are too precise."""
    world, late, at_once = driven("range-bearing", correction)
    scan = world.seen(np.array([*range(40), 39]))
    scan.cov[-2:] *= 1e-20
    for slam in (late, at_once):
        slam.predict(np.zeros(3), np.diag([1.0, 1.0, 1e-3]))
        with pytest.raises(UserError, match="no update exists"):
            slam.update(scan)
    assert is_deferred(late)
    assert_same(late, at_once, whole=True)


@DEFERRING
def test_rows_deferred_by_a_refused_scan_are_removed(correction: str) -> None:
    """The update with an old landmark succeeds before that with a new landmark, observed three times, is refused."""
    world, late, at_once = driven("range-bearing", correction)
    scan = world.seen(np.array([3, 405, 405, 405]))
    scan.cov[-2:] *= 1e-24
    for slam in (late, at_once):
        with pytest.raises(UserError, match="no update exists"):
            slam.update(scan)
    assert_same(late, at_once, whole=True)


@DEFERRING
def test_bearing_filters_defer_too(correction: str) -> None:
    """Points are observed one at a time; a ray starts and ends in between."""
    rule, rng = RULES[correction], np.random.default_rng(3)  # pyrefly: ignore[bad-index]
    late, at_once = (
        BearingFilter(np.zeros(3), PRIOR_COV, each) for each in (rule, rule._replace(deferred_rows=(1, 0)))
    )
    landmarks = rng.uniform([-9.0, 0.0], [9.0, 18.0], (111, 2))
    pose, waited = np.zeros(3), 0
    for step in range(80):
        pose[:2] += rotation(pose[2]) @ [0.6, 0.0]
        pose[2] += 0.066
        ids = np.arange(110) if step < 25 else np.array([110 if step in (30, 35, 40) else step])
        value = bearings((landmarks[ids] - pose[:2]) @ rotation(pose[2])) + rng.normal(0.0, 0.01, (len(ids), 1))
        scan = Observations(ids, value, np.full((len(ids), 1, 1), 1e-4))
        increment = np.array([0.6, 0.0, 0.066]) + rng.normal(0.0, [0.01, 0.003, 0.002])
        results = []
        for slam in (late, at_once):
            slam.predict(increment, np.diag([1e-4, 1e-5, 4e-6]))
            results.append(slam.update(scan))
        waited += is_deferred(late)
        assert results[0] == pytest.approx(results[1], rel=1e-9, abs=1e-9)
        sigmas = np.sqrt(np.diagonal(at_once.pose_cov))
        assert (np.abs(late.pose - at_once.pose) <= 1e-9 * sigmas).all()
        assert (np.abs(late.pose_cov - at_once.pose_cov) <= 1e-9 * np.outer(sigmas, sigmas)).all()
    assert waited > 25
    sigmas = np.sqrt(np.diagonal(at_once.cov))
    assert (np.abs(late.cov - at_once.cov) <= 1e-9 * np.outer(sigmas, sigmas)).all()
