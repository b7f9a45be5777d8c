"""The compiled filters compared with dense textbook filters on random recordings."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from slamgauge.ekf import SlamFilter, estimators
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.maps.correction_table import CORRECTIONS, RULES, Correction
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from tests.marks import in_full
from tests.reference.random_recordings import random_recording
from tests.reference.textbook import PAIRS

pytestmark = pytest.mark.slow

Estimator = Callable[[Recording], Estimate]


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize(
    "options",
    [{"slip": True}, {"slip": False}, {"slip": False, "prior_sigmas": (0.0, 0.0, 0.0)}],
    ids=["slip", "no-slip", "fixed-start"],
)
@pytest.mark.parametrize("seed", [0, *in_full(range(1, 5))])
@pytest.mark.parametrize(("ours", "textbook"), PAIRS.values(), ids=PAIRS)
def test_equals_the_textbook(
    ours: Estimator, textbook: Estimator, seed: int, options: dict[str, Any], sensor: str
) -> None:
    _, recording = random_recording(seed, sensor=sensor, steps=80, landmarks=9, **options)
    assert_same(ours(recording), textbook(recording))


def assert_same(actual: Estimate, expected: Estimate) -> None:
    for name in ("poses", "pose_covs", "landmark_ids", "landmarks", "landmark_covs", "nis", "nis_dof"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("correction", RULES)
@pytest.mark.parametrize("updates", [10_000, *in_full([100_000])])
def test_full_covariance_stays_positive_semi_definite_over_many_updates(updates: int, correction: Correction) -> None:
    """The robot moves back and forth without slip, with six landmarks in view."""
    slam = SlamFilter("range-bearing", np.zeros(3), np.diag([0.01, 0.01, 1e-4]), correction)
    rng, sigmas = np.random.default_rng(0), np.array([0.1, np.deg2rad(5)])
    positions = rng.uniform(-8, 8, (6, 2))
    values = np.column_stack([np.hypot(*positions.T), np.arctan2(positions[:, 1], positions[:, 0])])
    covs = np.tile(np.diag(sigmas) ** 2, (6, 1, 1))
    for k in range(updates):
        slam.predict([0.1 if k % 2 else -0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        slam.update(Observations(np.arange(6), values + rng.normal(size=values.shape) * sigmas, covs))
    eigenvalues = np.linalg.eigvalsh(slam.cov)
    assert eigenvalues[0] > -1e-15 * eigenvalues[-1]
    assert np.array_equal(slam.cov, slam.cov.T)


def test_a_landmark_at_the_robot_gives_no_information() -> None:
    slam = SlamFilter("range-bearing", np.zeros(3), np.zeros((3, 3)))
    sight = Observations(np.array([1]), np.array([[0.0, 0.3]]), np.diag([0.01, 0.01])[None])
    slam.update(sight)
    nis, dof = slam.update(sight)
    assert (nis, dof) == (0.0, 0)
    assert np.isfinite(slam.landmarks).all()


def test_bearing_only_sensors_are_refused() -> None:
    blind = SlamFilter("bearing", np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="one bearing does not place a landmark"):
        blind.update(Observations(np.array([0]), np.zeros((1, 1)), np.ones((1, 1, 1))))


def test_every_correction_is_an_estimator() -> None:
    assert {*CORRECTIONS.values()} == {*RULES}
    for name in CORRECTIONS:
        assert callable(getattr(estimators, "ekf_slam" if name == "ekf" else name.replace("-", "_")))


@pytest.mark.parametrize("correction", RULES)
def test_a_pickled_filter_continues_with_the_same_results(correction: Correction) -> None:
    """Copies of filters run in other processes."""
    _, recording = random_recording(3)
    slam = SlamFilter("range-bearing", recording.prior_mean, recording.prior_cov, correction)
    assert len([*drive(slam, recording.first(5))]) == 6
    other = pickle.loads(pickle.dumps(slam))
    for each in (slam, other):
        assert len([*drive(each, recording)]) == recording.steps + 1
    np.testing.assert_array_equal(other.pose, slam.pose)
    np.testing.assert_array_equal(other.cov, slam.cov)
