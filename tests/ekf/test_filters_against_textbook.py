"""The compiled filters against dense textbook filters on random recordings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slamgauge.ekf import SlamFilter
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from tests.reference.random_recordings import random_recording
from tests.reference.textbook_pairs import PAIRS

Estimator = Callable[[Recording], Estimate]


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("ours", "textbook"), PAIRS)
def test_equals_the_textbook(ours: Estimator, textbook: Estimator, seed: int, slip: bool, sensor: str) -> None:
    _, recording = random_recording(seed, sensor=sensor, slip=slip, steps=80, landmarks=9)
    assert_same(ours(recording), textbook(recording))


@pytest.mark.parametrize(("ours", "textbook"), PAIRS)
def test_equals_the_textbook_from_a_fixed_start(ours: Estimator, textbook: Estimator) -> None:
    _, recording = random_recording(11, prior_sigmas=(0.0, 0.0, 0.0), slip=False)
    assert_same(ours(recording), textbook(recording))


def assert_same(actual: Estimate, expected: Estimate) -> None:
    for name in ("poses", "pose_covs", "landmark_ids", "landmarks", "landmark_covs", "nis", "nis_dof"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("correction", RULES)
def test_full_covariance_stays_positive_semi_definite_over_many_updates(correction: Correction) -> None:
    """100 000 updates of one scan; the covariance must neither lose symmetry nor an eigenvalue's sign."""
    slam = SlamFilter("range-bearing", np.zeros(3), np.diag([0.01, 0.01, 1e-4]), correction)
    rng = np.random.default_rng(0)
    positions = rng.uniform(-8, 8, (6, 2))
    values = np.column_stack([np.hypot(*positions.T), np.arctan2(positions[:, 1], positions[:, 0])])
    covs = np.tile(np.diag([0.1, np.deg2rad(5)]) ** 2, (6, 1, 1))
    for k in range(100_000):
        slam.predict([0.1 if k % 2 else -0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        shifted = values + rng.normal(size=values.shape) * [0.1, np.deg2rad(5)]
        slam.update(Observations(np.arange(6), shifted, covs))
    eigenvalues = np.linalg.eigvalsh(slam.cov)
    assert eigenvalues[0] > -1e-15 * eigenvalues[-1]
    assert np.array_equal(slam.cov, slam.cov.T)


def test_a_landmark_seen_twice_at_its_first_step_is_mapped_once_and_then_corrected() -> None:
    twice = SlamFilter("position", np.zeros(3), np.eye(3) * 0.01)
    covs = np.tile(np.eye(2) * 0.04, (2, 1, 1))
    nis, dof = twice.update(Observations(np.array([7, 7]), np.array([[2.0, 1.0], [2.2, 1.0]]), covs))
    assert dof == 2
    assert nis == pytest.approx(0.2**2 / 0.08)
    np.testing.assert_allclose(twice.landmarks, [[2.1, 1.0]], atol=1e-12)
    assert twice.landmark_ids.tolist() == [7]


def test_a_landmark_at_the_robot_gives_no_bearing_and_no_division_by_zero() -> None:
    slam = SlamFilter("range-bearing", np.zeros(3), np.zeros((3, 3)))
    sight = Observations(np.array([1]), np.array([[0.0, 0.3]]), np.diag([0.01, 0.01])[None])
    slam.update(sight)
    nis, dof = slam.update(sight)
    assert (nis, dof) == (0.0, 0)
    assert np.isfinite(slam.landmarks).all()


def test_growth_beyond_the_first_room_changes_nothing() -> None:
    _, recording = random_recording(3, landmarks=12)
    roomy, tight = (
        SlamFilter("range-bearing", recording.prior_mean, recording.prior_cov, landmarks=n) for n in (12, 0)
    )
    for k, scan in enumerate(recording.scans()):
        for slam in (roomy, tight):
            if k:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            slam.update(scan)
    assert np.array_equal(roomy.cov, tight.cov)
    assert np.array_equal(roomy.landmarks, tight.landmarks)


@pytest.mark.parametrize("broken", ["increment", "value", "new value", "cov"])
def test_bad_numbers_are_refused_and_leave_the_filter_as_it_was(broken: str) -> None:
    _, recording = random_recording(4)
    slam = SlamFilter("range-bearing", recording.prior_mean, recording.prior_cov)
    scan = next(s for s in recording.scans() if len(s.value) > 1)
    slam.update(scan)
    before = slam.pose, slam.cov
    values, covs = scan.value.copy(), scan.cov.copy()
    values[0] = np.nan
    covs[:] = -1e3 * np.eye(2)
    with pytest.raises(ValueError, match="a negative variance" if broken == "cov" else "must be finite"):
        if broken == "increment":
            slam.predict([np.nan, 0, 0], np.eye(3))
        elif broken == "cov":
            slam.update(Observations(scan.landmark, scan.value, covs))
        else:
            assert scan.landmark is not None
            slam.update(Observations(scan.landmark + 100 * (broken == "new value"), values, scan.cov))
    assert np.array_equal(slam.pose, before[0])
    assert np.array_equal(slam.cov, before[1])


def test_unknown_association_and_foreign_sensors_are_refused() -> None:
    _, recording = random_recording(5)
    with pytest.raises(ValueError, match="known association"):
        SlamFilter("position", np.zeros(3), np.eye(3)).update(Observations(None, np.zeros((1, 2)), np.eye(2)[None]))
    with pytest.raises(ValueError, match="'sonar' does not fit"):
        SlamFilter("sonar", recording.prior_mean, recording.prior_cov)
    blind = SlamFilter("bearing", recording.prior_mean, recording.prior_cov)
    with pytest.raises(ValueError, match="a bearing alone places no landmark"):
        blind.update(Observations(np.array([0]), np.zeros((1, 1)), np.ones((1, 1, 1))))
