"""GTSAM's batch solution compared with `batch`, on every shipped scenario and on small recordings.

The differences have three causes: regularising noise for zero variances, the range and bearing that replace an
observation of the `position` sensor, and the tolerance of Levenberg-Marquardt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge import gtsam_batch, load_scenario, shipped_scenarios, simulate
from slamgauge.ekf import dead_reckoning, ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, batch
from slamgauge.recording import Recording
from tests.reference.given import given
from tests.reference.random_recordings import recording_of
from tests.reference.small_problems import Answer, answer, assert_same_covariances, pose_difference, sigmas_of

KNOWN_START = "bailey-2006"
RANGE_BEARING = [name for name, _ in shipped_scenarios() if load_scenario(name).sensor.kind == "range-bearing"]


def recording_of_scenario(name: str, seed: int = 0) -> Recording:
    """Return the recording of a seed with true associations."""
    truth, recording = simulate(load_scenario(name), seed)
    return recording.associated(np.where(given(truth.misleading), -1, given(truth.association)))


SOLVED: dict[bytes, tuple[Answer, Answer]] = {}  # scenarios of questions 1 to 3 share recordings


def both(recording: Recording) -> tuple[Answer, Answer]:
    key = b"".join(each.tobytes() for each in (recording.observation, recording.observation_cov, recording.odometry))
    if key not in SOLVED:
        SOLVED[key] = answer(gtsam_batch(recording)), answer(batch(recording))
    return SOLVED[key]


def largest_difference(found: Answer, optimum: Answer) -> float:
    """Return the largest difference of poses in standard deviations of the optimum."""
    return float(np.abs(pose_difference(found.poses, optimum)).max())


def assert_same_optimum(found: Answer, optimum: Answer, first: int = 0) -> None:
    """Compare poses and map to 0.001 standard deviations; covariances, from step `first` on, to 0.1 % of variances."""
    assert largest_difference(found, optimum) < 1e-3
    assert_same_covariances(found.pose_covs[first:], optimum.pose_covs[first:], 1e-3)
    np.testing.assert_array_equal(found.ids, optimum.ids)
    assert (np.abs(found.landmarks - optimum.landmarks) / sigmas_of(optimum.landmark_covs)).max() < 1e-3
    assert_same_covariances(found.landmark_covs, optimum.landmark_covs, 1e-3)


@pytest.mark.parametrize("name", [name for name in RANGE_BEARING if name != KNOWN_START])
def test_every_range_bearing_scenario_has_the_same_optimum(name: str) -> None:
    """Measured: poses to 0.0006 standard deviations and standard deviations to 0.01 %, from regularising noise."""
    assert_same_optimum(*both(recording_of_scenario(name)))


@pytest.mark.parametrize(
    ("name", "seed"), [("q1-long-dense", 3), ("q3-scale-0.1", 4), ("q3-scale-10", 4), ("freiburg-course", 4)]
)
def test_other_seeds_have_the_same_optimum(name: str, seed: int) -> None:
    """On `freiburg-course` 4, an update of iSAM2 for every 20 steps would lead to another minimum."""
    assert_same_optimum(*both(recording_of_scenario(name, seed)))


def test_after_a_known_start_regularising_noise_changes_sigmas_of_the_first_steps() -> None:
    """The lateral sigma of step 1 is 0.17 mm instead of 0.13 mm; from step 2 on, all are the same to 0.4 %."""
    found, optimum = both(recording_of_scenario(KNOWN_START))
    assert_same_optimum(found, optimum, first=10)
    sigmas, expected = sigmas_of(found.pose_covs), sigmas_of(optimum.pose_covs)
    np.testing.assert_allclose(sigmas[1], expected[1], rtol=0, atol=5e-5)
    np.testing.assert_allclose(sigmas[2:], expected[2:], rtol=0.01)


@pytest.mark.parametrize("name", ["q4-three-landmarks", "q4-ring"])
def test_a_bearing_only_scenario_has_the_same_optimum(name: str) -> None:
    assert_same_optimum(*both(simulate(load_scenario(name, ["start=sampled"]), 1)[1]))


@pytest.mark.parametrize(("name", "steps"), [("ukfm-slam2d", 600), ("huang-2010", 400)])
def test_range_and_bearing_instead_of_positions_move_poses(name: str, steps: int) -> None:
    """By 0.03 and 0.14 standard deviations."""
    found, optimum = both(recording_of_scenario(name).first(steps))
    assert 1e-3 < largest_difference(found, optimum) < 0.2
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 0.06)


def test_a_given_initial_estimate_decides_which_minimum_is_found() -> None:
    """Dead reckoning of `ukfm-slam2d` leads to another minimum; the path of the EKF to that of iSAM2's path."""
    recording = recording_of_scenario("ukfm-slam2d").first(300)
    moved = replace(recording, prior_mean=np.array([4e3, -3e3, 2.0]))  # the path is relative to the start
    optimum = answer(gtsam_batch(moved))
    from_filter = answer(gtsam_batch(moved, initial=ekf_slam(moved)))
    from_odometry = answer(gtsam_batch(moved, initial=dead_reckoning(moved)))
    assert largest_difference(from_filter, optimum) < 1e-4
    assert largest_difference(from_odometry, optimum) > 10.0


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (lambda recording: recording, "^initial: is of type Recording; give type Estimate$"),
        (lambda recording: ekf_slam(recording.first(3)), "^initial: has 4 poses, and the recording 41; [^\n]*$"),
    ],
)
def test_an_initial_estimate_of_something_else_is_refused(initial: Callable[..., Estimate], message: str) -> None:
    recording = recording_of("range-bearing", 0)
    with pytest.raises(UserError, match=message):
        gtsam_batch(recording, initial=initial(recording))


def test_a_start_far_from_the_origin_costs_no_accuracy() -> None:
    recording = recording_of("range-bearing", 2, slip=False)
    moved = replace(recording, prior_mean=np.array([4e6, -3e6, 2.0]), prior_cov=0.01 * np.eye(3))
    found, optimum = both(moved)
    assert largest_difference(found, optimum) < 1e-3
    assert_same_covariances(found.pose_covs, optimum.pose_covs, 1e-3)


def test_where_marginals_lose_digits_covariances_come_from_qr(monkeypatch: pytest.MonkeyPatch) -> None:
    """So does GTSAM on a path of 1350 poses without slip."""

    def loses_digits(*_: object) -> None:
        raise RuntimeError("Indeterminate linear system detected while working near variable (Symbol: x3)")

    monkeypatch.setattr("gtsam.Marginals", loses_digits)
    recording = recording_of("range-bearing", 2, slip=False)
    assert_same_optimum(answer(gtsam_batch(recording)), answer(batch(recording)))


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
