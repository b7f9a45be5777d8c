"""The Cramer-Rao bound compared with dense information matrices, Kalman filters and errors of estimators."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, textbook_ekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator
from slamgauge.graph_baseline import batch, causal, causal_bound, hindsight_bound
from slamgauge.graph_baseline.problem.placement import MAX_LANDMARK_SIGMA
from slamgauge.recording import Recording
from slamgauge.se2 import between, rotation, wrap
from slamgauge.sensors import Sensor
from slamgauge.truth import Truth
from tests.reference.given import given
from tests.reference.jacobians import differentiate
from tests.reference.random_recordings import bearing_only, random_recording

SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
SLIP = pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])


def small_run(
    seed: int, sensor: Sensor, *, slip: bool = True, noise: float = 1.0, steps: int = 12
) -> tuple[Truth, Recording]:
    """Return truth and recording of a random run with the landmark ids 0 to 3."""
    kind = "range-bearing" if sensor == "bearing" else sensor
    truth, recording = random_recording(seed, sensor=kind, slip=slip, noise=noise, steps=steps, landmarks=4)
    association = np.searchsorted(given(truth.landmark_ids), given(truth.association))
    truth = replace(truth, landmark_ids=np.arange(4), association=association)
    recording = replace(recording, landmark=association)
    return truth, bearing_only(recording) if sensor == "bearing" else recording


def predicted(sensor: str, pose: Float, landmark: Float) -> Float:
    x, y = rotation(pose[2]).T @ (landmark - pose[:2])
    return {
        "position": np.array([x, y]),
        "range-bearing": np.array([np.hypot(x, y), np.arctan2(y, x)]),
        "bearing": np.array([np.arctan2(y, x)]),
    }[sensor]


def dense_information(truth: Truth, recording: Recording, last: int) -> Float:
    """Return the information about all poses and landmarks up to step `last`, by central differences at the truth."""
    assert truth.association is not None
    poses, landmarks = given(truth.poses), given(truth.landmarks)
    size = 3 * len(poses)
    total = np.zeros((size + landmarks.size, size + landmarks.size))
    total[:3, :3] = np.linalg.inv(recording.prior_cov)
    total[range(size, len(total)), range(size, len(total))] = MAX_LANDMARK_SIGMA**-2
    for k in range(last):
        H = differentiate(lambda both: between(both[:3], both[3:]), poses[k : k + 2].ravel())
        rows = slice(3 * k, 3 * k + 6)
        total[rows, rows] += H.T @ np.linalg.inv(recording.odometry_cov[k]) @ H
    for k, name, cov in zip(recording.observation_step, truth.association, recording.observation_cov, strict=True):
        if k <= last:
            at = np.concatenate([poses[k], landmarks[name]])
            H = differentiate(lambda both: predicted(recording.sensor, both[:3], both[3:]), at)
            columns = [*range(3 * k, 3 * k + 3), size + 2 * name, size + 2 * name + 1]
            total[np.ix_(columns, columns)] += H.T @ np.linalg.inv(cov) @ H
    return total


@SENSORS
def test_bounds_are_blocks_of_the_inverse_information_at_the_truth(sensor: Sensor) -> None:
    truth, recording = small_run(1, sensor)
    steps = recording.steps
    hindsight = np.linalg.inv(dense_information(truth, recording, steps))
    blocks = np.array([hindsight[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(steps + 1)])
    np.testing.assert_allclose(hindsight_bound(truth, recording), blocks, rtol=1e-6, atol=1e-6 * blocks.max())
    causal = causal_bound(truth, recording)
    for k in range(steps + 1):
        information = dense_information(truth, recording, k)
        known = np.flatnonzero(np.diag(information) > 0)
        block = np.linalg.inv(information[np.ix_(known, known)])[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        np.testing.assert_allclose(causal[k], block, rtol=1e-6, atol=1e-6 * block.max())


def without_noise(truth: Truth, recording: Recording) -> Recording:
    """Return the measurements without noise, so that estimate and Jacobians of a filter stay at the truth."""
    assert truth.poses is not None
    observed = zip(recording.observation_step, given(truth.association), strict=True)
    return replace(
        recording,
        prior_mean=truth.poses[0],
        odometry=between(truth.poses[:-1], truth.poses[1:]),
        observation=np.array(
            [predicted(recording.sensor, truth.poses[k], given(truth.landmarks)[name]) for k, name in observed]
        ),
    )


@SLIP
@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_the_causal_bound_is_the_covariance_of_a_filter_at_the_truth(sensor: Sensor, slip: bool) -> None:
    truth, recording = small_run(2, sensor, slip=slip, steps=40)
    ideal = textbook_ekf(without_noise(truth, recording))
    assert ideal.pose_covs is not None
    bound = causal_bound(truth, recording)
    np.testing.assert_allclose(bound, ideal.pose_covs, rtol=0, atol=1e-9 * np.abs(ideal.pose_covs).max())
    np.testing.assert_allclose(hindsight_bound(truth, recording)[-1], bound[-1], rtol=0, atol=1e-9 * bound[-1].max())


def test_in_a_linear_problem_the_bounds_are_the_covariances_of_filter_and_optimum() -> None:
    """The problem is linear because the heading is known exactly.

    The noise is isotropic, because the graph adds it in the frame of a step's end and the simulation in that of its
    start.
    """
    truth, recording = random_recording(3, sensor="position", prior_sigmas=(0.1, 0.2, 0.0))
    assert truth.poses is not None
    covs = np.tile(np.diag([0.03, 0.03, 0.0]) ** 2, (recording.steps, 1, 1))
    turned = np.column_stack([recording.odometry[:, :2], between(truth.poses[:-1], truth.poses[1:])[:, 2]])
    start = np.append(recording.prior_mean[:2], truth.poses[0, 2])
    recording = replace(recording, prior_mean=start, odometry=turned, odometry_cov=covs)
    causal, hindsight = causal_bound(truth, recording), hindsight_bound(truth, recording)
    kalman, smoothed = ekf_slam(recording).pose_covs, batch(recording).pose_covs
    assert kalman is not None
    assert smoothed is not None
    np.testing.assert_allclose(causal, kalman, rtol=0, atol=1e-9 * kalman.max())
    np.testing.assert_allclose(hindsight[-1], smoothed[-1], rtol=0, atol=1e-9 * smoothed.max())


@pytest.mark.parametrize("estimator", [causal, batch])
def test_the_errors_of_the_optima_reach_the_bound_as_noise_shrinks(estimator: Estimator) -> None:
    """The NEES of the last pose with the bound as covariance, summed over 60 runs; false-alarm rate 0.001."""
    total = 0.0
    for seed in range(60):
        truth, recording = small_run(seed, "range-bearing", noise=0.1)
        error = estimator(recording).poses[-1] - given(truth.poses)[-1]
        error[2] = wrap(error[2])
        total += float(error @ np.linalg.solve(causal_bound(truth, recording)[-1], error))
    assert chi2.ppf(0.0005, 180) < total < chi2.ppf(0.9995, 180)


def test_clutter_and_outliers_are_ignored_and_ids_may_have_any_order() -> None:
    truth, recording = small_run(4, "range-bearing")
    assert truth.association is not None
    outlier = np.arange(len(truth.association)) % 5 == 0
    clutter = np.arange(len(truth.association)) % 10 == 0
    marked = replace(truth, association=np.where(clutter, -1, truth.association), outlier=outlier)
    rest = replace(truth, association=truth.association[~outlier])
    expected = causal_bound(rest, recording.only(~outlier))
    np.testing.assert_allclose(causal_bound(marked, recording), expected, rtol=1e-12)
    names = np.array([30, 7, 99, 2])
    renamed = replace(rest, landmark_ids=names, association=names[rest.association])
    np.testing.assert_allclose(causal_bound(renamed, recording.only(~outlier)), expected, rtol=1e-9)


def test_a_truth_without_landmarks_associations_or_one_of_the_poses_is_refused() -> None:
    truth, recording = small_run(6, "range-bearing")
    poses = given(truth.poses).copy()
    poses[5] = np.nan
    missing: list[dict[str, Any]] = [{"landmark_ids": None, "landmarks": None}, {"association": None}, {"poses": poses}]
    for each in missing:
        with pytest.raises(UserError, match="truth: the bound needs all true poses, landmarks and associations"):
            causal_bound(replace(truth, **each), recording)
