"""Laws of filters: ids, frames, causality, unobservable directions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import (
    Association,
    Delayed,
    FilterSettings,
    MapManagement,
    Rays,
    SlamFilter,
    dead_reckoning,
    ekf_slam,
    fej_ekf,
    iekf,
    oc_ekf,
    riekf,
)
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.ekf.textbook import J
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between, compose, rotation
from tests.reference.given import given
from tests.reference.random_recordings import bearing_only, random_recording

Estimator = Callable[[Recording], Estimate]
FILTERS = pytest.mark.parametrize("estimator", [ekf_slam, fej_ekf, oc_ekf, iekf, riekf])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])


def covs_of(estimate: Estimate) -> Float:
    return given(estimate.pose_covs)


def map_of(estimate: Estimate) -> tuple[Int, Float, Float]:
    """Return ids in increasing order, landmarks and their covariances."""
    assert estimate.landmark_ids is not None
    order = np.argsort(estimate.landmark_ids)
    return estimate.landmark_ids[order], given(estimate.landmarks)[order], given(estimate.landmark_covs)[order]


def results_of(estimate: Estimate) -> list[Float | Int]:
    return [estimate.poses, covs_of(estimate), *map_of(estimate), given(estimate.nis)]


def ids_of(recording: Recording) -> Int:
    return given(recording.landmark)


def assert_close(actual: Float | Int, expected: Float | Int) -> None:
    """Compare up to rounding over some 60 updates of quantities of order 1 to 10."""
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-10)


# --- ids and order -------------------------------------------------------------------------------


@FILTERS
@SENSORS
def test_ids_of_landmarks_do_not_matter(estimator: Estimator, sensor: str) -> None:
    _, recording = random_recording(0, sensor=sensor, steps=60)
    ids = np.unique(ids_of(recording))
    names = np.random.default_rng(0).permutation(1000)[: len(ids)] * 10**9  # in another order, and large
    renamed = replace(recording, landmark=names[np.searchsorted(ids, ids_of(recording))])
    before, after = estimator(recording), estimator(renamed)
    assert_close(after.poses, before.poses)
    assert_close(covs_of(after), covs_of(before))
    new_names, landmarks, landmark_covs = map_of(after)
    old_names, old_landmarks, old_covs = map_of(before)
    back = np.searchsorted(new_names, names[np.searchsorted(ids, old_names)])
    assert_close(landmarks[back], old_landmarks)
    assert_close(landmark_covs[back], old_covs)


@FILTERS
@SENSORS
def test_the_order_of_a_steps_observations_does_not_matter(estimator: Estimator, sensor: str) -> None:
    _, recording = random_recording(1, sensor=sensor, steps=60)
    rng = np.random.default_rng(1)
    order = np.lexsort([rng.random(len(recording.observation)), recording.observation_step])
    assert not np.array_equal(order, np.arange(len(order)))
    before, after = estimator(recording), estimator(recording.only(order))
    for found, expected in zip(results_of(after), results_of(before), strict=True):
        assert_close(found, expected)


@FILTERS
def test_the_past_does_not_depend_on_the_future(estimator: Estimator) -> None:
    _, recording = random_recording(2, steps=40)
    whole, until = estimator(recording), 23
    cut = estimator(recording.first(until))
    np.testing.assert_array_equal(cut.poses, whole.poses[: until + 1])
    np.testing.assert_array_equal(covs_of(cut), covs_of(whole)[: until + 1])


@pytest.mark.parametrize("correction", RULES)
def test_a_step_without_observations_changes_nothing(correction: Correction) -> None:
    _, recording = random_recording(0)
    slam = SlamFilter(recording.sensor, recording.prior_mean, recording.prior_cov, correction)
    for scan in recording.scans():
        slam.update(scan)
        before = slam.pose, slam.landmarks, slam.cov
        nothing = Observations(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
        assert slam.update(nothing) == (0.0, 0)
        for actual, expected in zip((slam.pose, slam.landmarks, slam.cov), before, strict=True):
            np.testing.assert_array_equal(actual, expected)


# --- frames --------------------------------------------------------------------------------------

FAR = [500_000.0, 4_600_000.0, 2.5]  # [m, m, rad]: UTM coordinates in southern Europe, and a rotation
MOTIONS = pytest.mark.parametrize("motion", [[3.0, -4.0, 2.0], [-20.0, 7.0, math.pi], [0.0, 0.0, -3.1], FAR])
MANAGED = Association("jcbb", map_management=MapManagement())


def assert_moved_with_the_world(
    estimator: Callable[..., Estimate], recording: Recording, motion: list[float], *settings: FilterSettings
) -> None:
    """A prior moved by g gives poses and map moved by g, and rotated covariances: measurements are relative."""
    root = np.random.default_rng(3).normal(size=(3, 3)) * [[0.1], [0.1], [0.02]]
    recording = replace(recording, prior_cov=root @ root.T)  # without symmetry, so that a wrong frame shows
    turn = np.eye(3)
    R = turn[:2, :2] = rotation(motion[2])
    moved = replace(
        recording, prior_mean=compose(motion, recording.prior_mean), prior_cov=turn @ recording.prior_cov @ turn.T
    )
    before, after = estimator(recording, *settings), estimator(moved, *settings)
    tolerance = 1e-9 if motion is not FAR else 1e-7

    def assert_close(actual: Float, expected: Float) -> None:
        np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)

    assert_close(between(compose(motion, before.poses), after.poses), np.zeros_like(before.poses))
    assert_close(covs_of(after), turn @ covs_of(before) @ turn.T)
    for name in ("landmark_ids", "association", "nis_dof"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert_close(after.landmarks - motion[:2], before.landmarks @ R.T)
    if before.nis is not None and before.landmark_covs is not None:
        assert_close(np.asarray(after.nis), before.nis)
        assert_close(np.asarray(after.landmark_covs), R @ before.landmark_covs @ R.T)
    if before.history is not None and after.history is not None:
        assert_close(after.history.position - motion[:2], before.history.position @ R.T)
        assert_close(after.history.cov, R @ before.history.cov @ R.T)


@FILTERS
@SENSORS
@MOTIONS
def test_moving_the_world_moves_the_estimate_with_it(estimator: Estimator, sensor: str, motion: list[float]) -> None:
    assert_moved_with_the_world(estimator, random_recording(3, sensor=sensor, steps=60)[1], motion)


@FILTERS
@SENSORS
@pytest.mark.parametrize("association", [Association(), MANAGED], ids=["nearest-neighbour", "jcbb"])
def test_moving_the_world_moves_associations_with_it(
    estimator: Estimator, sensor: str, association: Association
) -> None:
    recording = replace(random_recording(30, sensor=sensor, steps=60, noise=0.5)[1], landmark=None)
    assert_moved_with_the_world(estimator, recording, FAR, FilterSettings(association, frames=5))


@FILTERS
@pytest.mark.parametrize("initialisation", [Rays(), Delayed()], ids=["rays", "delayed"])
def test_moving_the_world_moves_bearing_only_landmarks_with_it(
    estimator: Estimator, initialisation: Rays | Delayed
) -> None:
    recording = bearing_only(random_recording(31, steps=60, noise=0.2)[1])
    assert_moved_with_the_world(estimator, recording, FAR, FilterSettings(initialisation=initialisation, frames=5))


@MOTIONS
def test_moving_the_world_moves_dead_reckoning_with_it(motion: list[float]) -> None:
    assert_moved_with_the_world(dead_reckoning, random_recording(33, steps=60)[1], motion)


# --- unobservable directions ---------------------------------------------------------------------


def without_motion_noise(recording: Recording, *, standing: bool) -> Recording:
    """Return the recording with odometry covariances of zero, and without motion if `standing`."""
    odometry = np.zeros_like(recording.odometry) if standing else recording.odometry
    return replace(recording, odometry=odometry, odometry_cov=np.zeros_like(recording.odometry_cov))


def standing_robot(sensor: str) -> Recording:
    """Return observations of six landmarks, with noise, at 60 steps from the same place."""
    _, recording = random_recording(4, sensor=sensor, steps=60, prior_sigmas=(0.1, 0.1, 0.2))
    rng = np.random.default_rng(4)
    places = np.array([3.0, 0.0]) + [0.4, 0.7] * rng.uniform(-1, 1, (6, 2))
    exact = places[np.unique(ids_of(recording), return_inverse=True)[1]]
    noisy = exact + np.einsum("mij,mj->mi", np.linalg.cholesky(recording.observation_cov), rng.normal(size=exact.shape))
    return without_motion_noise(replace(recording, observation=noisy), standing=True)


def perfect_odometry(sensor: str) -> Recording:
    return without_motion_noise(random_recording(5, sensor=sensor, steps=60)[1], standing=False)


@SENSORS
@pytest.mark.parametrize("recorded", [standing_robot, perfect_odometry])
@pytest.mark.parametrize("consistent", [riekf, fej_ekf, oc_ekf])
def test_without_motion_noise_dead_reckoning_is_the_optimum(
    consistent: Estimator, recorded: Callable[[str], Recording], sensor: str
) -> None:
    """Only the start is uncertain, and new landmarks give no information about it (Julier and Uhlmann, ICRA 2001)."""
    recording = recorded(sensor)
    estimate, blind = consistent(recording), dead_reckoning(recording)
    rounding = 1e-15 if recorded is standing_robot else 1e-14
    if recorded is standing_robot:
        still = np.ones((61, 1))
        np.testing.assert_allclose(estimate.poses, still * recording.prior_mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(covs_of(estimate), still[:, :, None] * recording.prior_cov, rtol=0, atol=1e-15)
    np.testing.assert_allclose(between(blind.poses, estimate.poses), 0.0, atol=1e-12)
    np.testing.assert_allclose(covs_of(estimate), covs_of(blind), rtol=0, atol=rounding)

    claimed = covs_of(ekf_slam(recording))[-1, 2, 2] / covs_of(blind)[-1, 2, 2]
    assert claimed < 0.9  # the known fault of the textbook filter, which shows that this test can fail


@SENSORS
@pytest.mark.parametrize("correction", ["right-invariant", "first-estimates", "observability-constrained"])
def test_prior_uncertainty_of_the_whole_world_passes_through_unchanged(sensor: str, correction: Correction) -> None:
    """Prior covariance S of a translation and rotation of the whole world (1 m, 2 m, 0.3 rad).

    It changes no estimate, and adds N S N' to the covariance, N = [I, J p; 0, 1; I, J l]: the filter gains no
    information in unobservable directions. This is exact for the right-invariant filter at its estimate, whatever the
    gains, and because H F...F N = 0 for the others at the predicted pose and every landmark's first estimate.
    """
    _, recording = random_recording(6, sensor=sensor, steps=60)
    S = np.array([[1.0, 0.0, 0.2], [0.0, 4.0, 0.0], [0.2, 0.0, 0.09]])
    N = np.vstack([turned(recording.prior_mean[None, :2]), [0, 0, 1]])
    doubtful = replace(recording, prior_cov=recording.prior_cov + N @ S @ N.T)
    pair = [SlamFilter(sensor, each.prior_mean, each.prior_cov, correction) for each in (recording, doubtful)]
    first, invariant = np.zeros((0, 2)), correction == "right-invariant"
    for k, scan in enumerate(recording.scans()):
        if k:
            for slam in pair:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        predicted = pair[0].pose
        for slam in pair:
            slam.update(scan)
        sure, unsure = pair
        first = np.concatenate([first, sure.landmarks[len(first) :]])
        pose, landmarks = (sure.pose, sure.landmarks) if invariant else (predicted, first)
        N = np.vstack([turned(pose[None, :2]), [0, 0, 1], turned(landmarks)])
        np.testing.assert_allclose(unsure.pose, sure.pose, rtol=0, atol=1e-11)
        np.testing.assert_allclose(unsure.landmarks, sure.landmarks, rtol=0, atol=1e-11)
        np.testing.assert_allclose(unsure.cov, sure.cov + N @ S @ N.T, rtol=0, atol=1e-11 if invariant else 1e-9)

    assert np.abs(ekf_slam(doubtful).poses - ekf_slam(recording).poses).max() > 0.01  # the textbook filter fails


def turned(points: Float) -> Float:
    """Return rows [I, J p] (2n, 3) for points (n, 2)."""
    return np.concatenate([np.tile(np.eye(2), (len(points), 1, 1)), (points @ J.T)[:, :, None]], axis=2).reshape(-1, 3)
