"""Filters without ids: nearest neighbour compared with the textbook, joint association, rules within a scan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Int
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import FilterSettings, ekf_slam, fej_ekf, iekf, oc_ekf, riekf
from slamgauge.ekf.associating_filter import AssociatingFilter
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.correction_table import BLOCK
from slamgauge.ekf.settings import Association, MapManagement
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from tests.marks import in_full
from tests.reference.random_recordings import random_recording
from tests.reference.textbook import Kind, textbook_nearest_neighbour

pytestmark = pytest.mark.slow

Estimator = Callable[[Recording, FilterSettings], Estimate]
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
KINDS: dict[Estimator, Kind] = {
    ekf_slam: "standard",
    fej_ekf: "first-estimates",
    oc_ekf: "observable",
    iekf: "iterated",
    riekf: "invariant",
}
FILTERS = pytest.mark.parametrize("estimator", KINDS)
GATES = pytest.mark.parametrize("gate", [1.0, 9.0, 100.0])
MANAGED = Association("jcbb", map_management=MapManagement())


def nameless(seed: int, sensor: str, **options: float) -> Recording:
    _, recording = random_recording(seed, sensor=sensor, **options)  # pyrefly: ignore[bad-argument-type]
    return replace(recording, landmark=None)


def ids_of(estimate: Estimate) -> Int:
    assert estimate.association is not None
    return estimate.association


def assert_same(actual: Estimate, expected: Estimate) -> None:
    """Compare associations exactly, the rest to rounding."""
    np.testing.assert_array_equal(ids_of(actual), ids_of(expected))
    for name in ("landmark_ids", "poses", "pose_covs", "landmarks", "landmark_covs", "nis", "nis_dof"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


# --- nearest neighbour ---------------------------------------------------------------------------


def assert_textbook(estimator: Estimator, recording: Recording, gate: float) -> None:
    actual = estimator(recording, FilterSettings(Association(gate=gate)))
    assert_same(actual, textbook_nearest_neighbour(recording, gate, KINDS[estimator]))


@FILTERS
@SENSORS
@GATES
@pytest.mark.parametrize("seed", [0, *in_full([1])])
def test_nearest_neighbour_equals_the_textbook(estimator: Estimator, sensor: str, gate: float, seed: int) -> None:
    assert_textbook(estimator, nameless(seed, sensor, steps=20, landmarks=8), gate)


@pytest.mark.parametrize("estimator", [ekf_slam, fej_ekf, riekf, *in_full([oc_ekf, iekf])])
@SENSORS
def test_nearest_neighbour_equals_the_textbook_for_large_scans_from_an_uncertain_start(
    estimator: Estimator, sensor: str
) -> None:
    """More observations than a block has, and large corrections between them."""
    _, recording = random_recording(5, sensor=sensor, steps=5, landmarks=50, prior_sigmas=(0.5, 0.5, 0.3))
    recording = replace(recording, landmark=None, odometry_cov=10 * recording.odometry_cov)
    assert np.bincount(recording.observation_step).min() > BLOCK
    assert_textbook(estimator, recording, 9.0)


@pytest.mark.full  # short loops are usual
@FILTERS
@GATES
def test_nearest_neighbour_equals_the_textbook_on_the_long_loop(estimator: Estimator, gate: float) -> None:
    scenario = load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=30"])
    recording = replace(simulate(scenario, 0)[1], landmark=None)
    if not (estimator is ekf_slam and gate == 100.0):  # one runs to the end, the others are shorter to save time
        recording = recording.first(30 if gate > 1.0 else 20)
    assert_textbook(estimator, recording, gate)


# --- filters -------------------------------------------------------------------------------------


def easy(seed: int, sensor: str) -> tuple[Recording, Int]:
    """Return a recording with little noise, and the true ids in the order of birth."""
    truth, recording = random_recording(seed, sensor=sensor, steps=40, landmarks=7, noise=0.2)
    assert truth.association is not None
    _, first, inverse = np.unique(truth.association, return_index=True, return_inverse=True)
    return replace(recording, landmark=None), np.argsort(np.argsort(first))[inverse]


@FILTERS
@SENSORS
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_joint_association_without_mistakes_equals_known_association(
    estimator: Estimator, sensor: str, seed: int
) -> None:
    recording, born = easy(seed, sensor)
    estimate = estimator(recording, FilterSettings(Association("jcbb", gate=16.0)))
    assert_same(estimate, estimator(replace(recording, landmark=born), FilterSettings(Association())))


@FILTERS
@SENSORS
@pytest.mark.parametrize("seed", range(3))
def test_estimates_with_map_management_are_valid(estimator: Estimator, sensor: str, seed: int) -> None:
    recording = nameless(seed, sensor, steps=60, prior_sigmas=(0.5, 0.5, 0.3))  # pyrefly: ignore[bad-argument-type]
    clutter = np.random.default_rng(seed).random(len(recording.observation)) < 0.05
    recording = replace(recording, observation=recording.observation + 3.0 * clutter[:, None] * [1, 0])
    estimate = estimator(recording, FilterSettings(MANAGED))
    ids = ids_of(estimate)
    assert estimate.landmark_ids is not None
    assert estimate.landmark_covs is not None
    assert estimate.pose_covs is not None
    for covs in (estimate.pose_covs, estimate.landmark_covs):
        np.testing.assert_array_equal(covs, covs.swapaxes(1, 2))
        eigenvalues = np.linalg.eigvalsh(covs)
        assert (eigenvalues[:, 0] > -1e-14 * eigenvalues[:, -1]).all()
    assert set(ids.tolist()) - {NONE} <= set(estimate.landmark_ids.tolist())
    assert 0.5 < np.mean(ids != NONE) < 1.0
    named = ids != NONE
    scans = np.column_stack([recording.observation_step, ids])[named]
    assert len(np.unique(scans, axis=0)) == len(scans)  # one observation per landmark and scan, also after merging


@FILTERS
@SENSORS
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_map_management_finds_the_true_landmarks_if_noise_is_small(
    estimator: Estimator, sensor: str, seed: int
) -> None:
    recording, born = easy(seed, sensor)
    estimate = estimator(recording, FilterSettings(MANAGED))
    ids = ids_of(estimate)
    pairs = np.unique(np.column_stack([ids, born])[ids != NONE], axis=0)
    assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs) == 7
    assert np.mean(ids != NONE) > 0.8  # the others are of tracks on probation, or of deleted ones


# --- ids and slots -------------------------------------------------------------------------------


@pytest.mark.parametrize("association", [Association(), Association("jcbb"), MANAGED], ids=["nn", "jcbb", "managed"])
def test_associated_and_standing_agree_with_the_estimate_and_ids_are_ignored(association: Association) -> None:
    _, named = random_recording(2, steps=60)
    recording = replace(named, landmark=None)
    slam = AssociatingFilter(recording.sensor, recording.prior_mean, recording.prior_cov, association=association)
    given: list[Int] = []
    for _, scan in zip(drive(slam, named), named.scans(), strict=True):
        given.append(slam.associated)
        assert len(slam.associated) == len(scan.value)
        assert np.isin(slam.standing(np.concatenate(given)), [*slam.landmark_ids.tolist(), NONE]).all()
    slam.predict(np.zeros(3), np.zeros((3, 3)))
    assert len(slam.associated) == 0
    estimate = ekf_slam(recording, FilterSettings(association))
    np.testing.assert_array_equal(slam.standing(np.concatenate(given)), ids_of(estimate))
    np.testing.assert_array_equal(slam.landmark_ids, estimate.landmark_ids)
    np.testing.assert_array_equal(slam.landmarks, estimate.landmarks)
    if association.map_management is None:  # no id changes, and all tracks are landmarks
        np.testing.assert_array_equal(np.concatenate(given), ids_of(estimate))
        np.testing.assert_array_equal(slam.landmark_ids, np.arange(len(slam.landmarks)))


# --- rules of a scan -----------------------------------------------------------------------------

NOISE = 0.01 * np.eye(2)


def before_landmarks(places: list[list[float]], association: Association, spread: float = 0.0) -> AssociatingFilter:
    """Return a filter that has observed landmarks six times, and then moved with uncertainty `spread` [m]."""
    slam = AssociatingFilter("position", np.zeros(3), np.zeros((3, 3)), association=association)
    for _ in range(6):
        assert (look(slam, places) >= 0).all()
    slam.predict(np.zeros(3), np.diag([spread, spread, 0.0]) ** 2)
    return slam


def look(slam: AssociatingFilter, places: list[list[float]]) -> Int:
    slam.update(Observations(None, np.array(places), np.tile(NOISE, (len(places), 1, 1))))
    return slam.associated


@pytest.mark.parametrize("gate", [4.0, 9.0, 25.0, 100.0])
def test_k_pairs_are_compared_with_the_quantile_of_the_gates_probability(gate: float) -> None:
    """The position is nearly unknown, so that the joint d^2 of two landmarks is that of their difference."""
    bound = chi2.isf(chi2.sf(gate, 2), 4)
    for factor, new in ((0.999, 0), (1.001, 1)):
        slam = before_landmarks([[2.0, 0.0], [0.0, 2.0]], Association("jcbb", gate), spread=100.0)
        apart = float(np.sqrt(factor * bound * 2 * (0.01 + 0.01 / 6)))  # variance of the difference
        assert np.sum(look(slam, [[2.0 + apart / 2, 0.0], [0.0 - apart / 2, 2.0]]) == 2) == new


@pytest.mark.parametrize("association", [Association(map_management=MapManagement()), MANAGED], ids=["nn", "jcbb"])
def test_an_outlier_of_a_landmark_without_other_observation_starts_no_track(association: Association) -> None:
    variance = 0.01 + 0.01 / 6
    for squared, free, alone in ((8.9, 0, 0), (9.1, NONE, 1), (27.5, NONE, 1), (27.7, 1, 1)):
        sight = [2.0 + np.sqrt(squared * variance), 0.0]
        slam = before_landmarks([[2.0, 0.0]], association)
        assert look(slam, [sight]).tolist() == [free]
        taken = before_landmarks([[2.0, 0.0]], association)
        if squared > 9.0:
            assert look(taken, [[2.0, 0.0], sight]).tolist()[1] == alone
