"""GTSAM's batch solution compared with `batch`, on every shipped scenario and on small recordings.

The differences have three causes: regularising noise where a variance is zero, the polar equivalent of the `position`
sensor, and the change of the cost at which Levenberg-Marquardt stops.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import gtsam_batch, load_scenario, shipped_scenarios, simulate
from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, batch
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording, recording_of

RANGE_BEARING = [name for name, _ in shipped_scenarios() if load_scenario(name).sensor.kind == "range-bearing"]
EXACT = 1e-9  # m or rad: a smaller standard deviation is zero


def recording_of_scenario(name: str) -> Recording:
    """The recording of seed 0 with true associations."""
    truth, recording = simulate(load_scenario(name), 0)
    assert truth.association is not None
    assert truth.misleading is not None
    return recording.associated(np.where(truth.misleading, -1, truth.association))


def standard_deviations(covariances: Float | None) -> Float:
    assert covariances is not None
    return np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))


def farthest(found: Estimate, optimum: Estimate) -> float:
    """The largest difference of poses, in standard deviations of the optimum."""
    apart, sigma = found.poses - optimum.poses, standard_deviations(optimum.pose_covs)
    apart[:, 2] = wrap(apart[:, 2])
    return float(np.max(np.abs(apart) / np.where(sigma > EXACT, sigma, np.inf)))


def assert_same_correlations_and_sigmas(found: Float | None, optimum: Float | None, tolerance: float) -> None:
    """Compare covariances entry by entry, in units of the optimum's standard deviations."""
    sigma = standard_deviations(optimum)
    assert found is not None and optimum is not None
    unit = np.where(sigma > EXACT, sigma, np.inf)
    scaled = (found - optimum) / (unit[:, :, None] * unit[:, None, :])
    assert np.abs(scaled).max() < tolerance


SOLVED: dict[bytes, tuple[Estimate, Estimate]] = {}  # scenarios of questions 1 to 3 share recordings


def both(recording: Recording) -> tuple[Estimate, Estimate]:
    key = b"".join(each.tobytes() for each in (recording.observation, recording.observation_cov, recording.odometry))
    if key not in SOLVED:
        SOLVED[key] = gtsam_batch(recording), batch(recording)
    return SOLVED[key]


@pytest.mark.parametrize("name", RANGE_BEARING)
def test_every_range_bearing_scenario_has_the_same_optimum(name: str) -> None:
    """Poses to 0.0006 standard deviations and standard deviations to 0.01 %; both come from regularising noise."""
    found, optimum = both(recording_of_scenario(name))
    assert farthest(found, optimum) < 1e-3
    assert_same_correlations_and_sigmas(found.pose_covs, optimum.pose_covs, 1e-3)
    assert_same_correlations_and_sigmas(found.landmark_covs, optimum.landmark_covs, 1e-3)
    np.testing.assert_array_equal(found.landmark_ids, optimum.landmark_ids)
    sigma = standard_deviations(optimum.landmark_covs)
    assert (np.abs(found.landmarks - optimum.landmarks) / sigma).max() < 1e-3


def test_bearing_only_landmarks_are_placed_and_solved() -> None:
    found, optimum = both(simulate(load_scenario("q4-three-landmarks", ["start=sampled"]), 1)[1])
    assert farthest(found, optimum) < 1e-3
    assert_same_correlations_and_sigmas(found.pose_covs, optimum.pose_covs, 1e-3)
    np.testing.assert_array_equal(found.landmark_ids, optimum.landmark_ids)


def test_where_dead_reckoning_leads_to_another_minimum_isam2_leads_to_the_optimum() -> None:
    """The first 600 of 2500 steps; the position sensor as range and bearing moves poses by 0.05 sigma, 0.1 at most."""
    found, optimum = both(recording_of_scenario("ukfm-slam2d").first(600))
    assert 1e-3 < farthest(found, optimum) < 0.1
    assert_same_correlations_and_sigmas(found.pose_covs, optimum.pose_covs, 0.06)


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_without_zero_variances_only_the_polar_equivalent_differs(sensor: str) -> None:
    found, optimum = both(recording_of(sensor, 1, slip=True))
    assert farthest(found, optimum) < (1e-5 if sensor == "range-bearing" else 0.06)


def test_far_from_the_origin_and_turned_nothing_is_lost() -> None:
    recording = recording_of("range-bearing", 2, slip=False)
    moved = replace(recording, prior_mean=np.array([4e6, -3e6, 2.0]), prior_cov=0.01 * np.eye(3))
    assert farthest(gtsam_batch(moved), batch(moved)) < 1e-3
    assert_same_correlations_and_sigmas(gtsam_batch(moved).pose_covs, batch(moved).pose_covs, 1e-3)


def test_a_landmark_with_a_single_bearing_is_left_out() -> None:
    recording = recording_of("bearing", 0)
    assert recording.landmark is not None
    ids = recording.landmark.copy()
    ids[len(ids) // 2] = 999
    found = gtsam_batch(replace(recording, landmark=ids))
    assert 999 not in found.landmark_ids
    np.testing.assert_array_equal(np.flatnonzero(found.association != ids)[[0]], [len(ids) // 2])


def test_given_associations_replace_ids_also_under_a_filter() -> None:
    _, recording = random_recording(1)
    assert recording.landmark is not None
    given = np.where(np.arange(len(recording.landmark)) % 4 == 0, -1, recording.landmark)
    np.testing.assert_array_equal(gtsam_batch(replace(recording, landmark=None), given).association, given)
    with pytest.raises(UserError, match="the graph needs known association"):
        gtsam_batch(replace(recording, landmark=None))
    under = load_estimators(["gtsam-batch@ekf"])["gtsam-batch@ekf"]
    np.testing.assert_array_equal(under(recording).poses, gtsam_batch(recording, ekf_slam(recording).association).poses)


def test_a_landmark_that_range_and_bearing_leave_undetermined_is_named() -> None:
    recording = recording_of("range-bearing", 0)
    assert recording.landmark is not None
    vague = recording.observation_cov.copy()
    vague[recording.landmark == recording.landmark[0]] = 1e14 * np.eye(2)
    with pytest.raises(UndeterminedError, match=f"^landmark {recording.landmark[0]}: "):
        gtsam_batch(replace(recording, observation_cov=vague))


@pytest.mark.parametrize("steps", [0, 1])
def test_a_recording_without_observations_gives_dead_reckoning(steps: int) -> None:
    recording = recording_of("range-bearing", 0).first(steps)
    alone = recording.only(np.zeros(len(recording.observation), dtype=bool))
    np.testing.assert_allclose(gtsam_batch(alone).poses, batch(alone).poses, atol=1e-9)
