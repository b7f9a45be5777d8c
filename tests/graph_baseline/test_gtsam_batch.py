"""GTSAM's batch solution compared with `batch`, on every shipped scenario and on small recordings.

The differences have three causes: regularising noise for zero variances, the range and bearing that replace an
observation of the `position` sensor, and the tolerance of Levenberg-Marquardt.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import gtsam_batch, load_scenario, shipped_scenarios, simulate
from slamgauge.graph_baseline import UndeterminedError, batch
from slamgauge.recording import Recording
from tests.reference.random_recordings import recording_of
from tests.reference.small_problems import Answer, answer, assert_same_covariances, pose_difference, sigmas_of

# without bailey-2006: after a known start, the sigmas of the first steps are those of GTSAM's regularising noise
SHIPPED = [name for name, _ in shipped_scenarios() if name != "bailey-2006"]
RANGE_BEARING = [name for name in SHIPPED if load_scenario(name).sensor.kind == "range-bearing"]


def recording_of_scenario(name: str) -> Recording:
    """Return the recording of seed 0 with true associations."""
    truth, recording = simulate(load_scenario(name), 0)
    assert truth.association is not None
    assert truth.misleading is not None
    return recording.associated(np.where(truth.misleading, -1, truth.association))


SOLVED: dict[bytes, tuple[Answer, Answer]] = {}  # scenarios of questions 1 to 3 share recordings


def both(recording: Recording) -> tuple[Answer, Answer]:
    key = b"".join(each.tobytes() for each in (recording.observation, recording.observation_cov, recording.odometry))
    if key not in SOLVED:
        SOLVED[key] = answer(gtsam_batch(recording)), answer(batch(recording))
    return SOLVED[key]


def largest_difference(found: Answer, optimum: Answer) -> float:
    """Return the largest difference of poses in standard deviations of the optimum."""
    return float(np.abs(pose_difference(found.poses, optimum)).max())


@pytest.mark.parametrize("name", RANGE_BEARING)
def test_every_range_bearing_scenario_has_the_same_optimum(name: str) -> None:
    """Poses to 0.0006 standard deviations and standard deviations to 0.01 %; both come from regularising noise."""
    found, optimum = both(recording_of_scenario(name))
    assert largest_difference(found, optimum) < 1e-3
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 1e-3)
    assert_same_covariances(found.landmark_covs, optimum.landmark_covs, 1e-3)
    np.testing.assert_array_equal(found.ids, optimum.ids)
    assert (np.abs(found.landmarks - optimum.landmarks) / sigmas_of(optimum.landmark_covs)).max() < 1e-3


def test_a_bearing_only_scenario_has_the_same_optimum() -> None:
    found, optimum = both(simulate(load_scenario("q4-three-landmarks", ["start=sampled"]), 1)[1])
    assert largest_difference(found, optimum) < 1e-3
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 1e-3)
    np.testing.assert_array_equal(found.ids, optimum.ids)


def test_isam2_gives_a_start_near_the_optimum_if_dead_reckoning_does_not() -> None:
    """First 600 of 2500 steps; range and bearing instead of positions move poses by 0.05 sigma, at most 0.1."""
    found, optimum = both(recording_of_scenario("ukfm-slam2d").first(600))
    assert 1e-3 < largest_difference(found, optimum) < 0.1
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 0.06)


@pytest.mark.parametrize(("sensor", "tolerance"), [("range-bearing", 1e-5), ("position", 0.06)])
def test_without_zero_variances_only_the_position_sensor_differs(sensor: str, tolerance: float) -> None:
    assert largest_difference(*both(recording_of(sensor, 1, slip=True))) < tolerance


def test_a_start_far_from_the_origin_costs_no_accuracy() -> None:
    recording = recording_of("range-bearing", 2, slip=False)
    moved = replace(recording, prior_mean=np.array([4e6, -3e6, 2.0]), prior_cov=0.01 * np.eye(3))
    found, optimum = both(moved)
    assert largest_difference(found, optimum) < 1e-3
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 1e-3)


def test_an_undetermined_landmark_is_named() -> None:
    recording = recording_of("range-bearing", 0)
    assert recording.landmark is not None
    vague = recording.observation_cov.copy()
    vague[recording.landmark == recording.landmark[0]] = 1e14 * np.eye(2)
    with pytest.raises(UndeterminedError, match=f"^landmark {recording.landmark[0]}: "):
        gtsam_batch(replace(recording, observation_cov=vague))


@pytest.mark.parametrize("steps", [0, 1])
def test_without_observations_the_result_is_that_of_batch(steps: int) -> None:
    recording = recording_of("range-bearing", 0).first(steps)
    alone = recording.only(np.zeros(len(recording.observation), dtype=bool))
    np.testing.assert_allclose(gtsam_batch(alone).poses, batch(alone).poses, atol=1e-9)
