"""The sigma-point right-invariant filter and the robocentric one: textbooks, consistency, refusals.

`test_laws` tests the laws that they share with the other filters, `test_numpy_filter_parts` their parts, and
`maps.test_input_checks` refused input.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, riukf, robocentric_ekf
from slamgauge.ekf.advanced.numpy_filter import MovingBelief, NumpyFilter
from slamgauge.ekf.advanced.robocentric import RobocentricBelief
from slamgauge.ekf.advanced.sigma_points import InvariantBelief
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import between
from slamgauge.sensors import Sensor
from tests.reference.circles import (
    STEPS,
    Estimator,
    additive_nees,
    back_and_forth,
    invariant_nees,
    outside,
    run_all,
)
from tests.reference.random_recordings import bearing_only, random_recording
from tests.reference.textbook_numpy_filters import textbook_riukf, textbook_robocentric_ekf

pytestmark = pytest.mark.slow

RELATIVES = pytest.mark.parametrize("estimator", [riukf, robocentric_ekf])
BELIEFS = pytest.mark.parametrize("belief_of", [InvariantBelief, RobocentricBelief])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
TEXTBOOKS = pytest.mark.parametrize(
    ("ours", "textbook"),
    [
        pytest.param(riukf, textbook_riukf, id="riukf"),
        pytest.param(robocentric_ekf, textbook_robocentric_ekf, id="robocentric-ekf"),
    ],
)
BeliefOf = Callable[[str, Float, Float], MovingBelief]


# --- textbooks -----------------------------------------------------------------------------------


@pytest.mark.full  # another seed is in the usual run
@TEXTBOOKS
@SENSORS
@pytest.mark.parametrize("seed", range(2))
def test_equals_the_textbook(ours: Estimator, textbook: Estimator, seed: int, sensor: str) -> None:
    recording = seen_again(random_recording(seed, sensor=sensor, steps=20)[1])
    assert_same(ours(recording), textbook(recording))


@TEXTBOOKS
def test_equals_the_textbook_from_a_fixed_start(ours: Estimator, textbook: Estimator) -> None:
    _, recording = random_recording(11, prior_sigmas=(0.0, 0.0, 0.0), slip=False, steps=30)
    assert_same(ours(recording), textbook(recording))


def seen_again(recording: Recording) -> Recording:
    """Return the recording with a second observation, with its own noise, for every third one."""
    rng, count = np.random.default_rng(0), len(recording.observation)
    rows = np.sort(np.concatenate([np.arange(count), np.arange(0, count, 3)]))
    assert recording.landmark is not None
    return replace(
        recording,
        observation_step=recording.observation_step[rows],
        observation=recording.observation[rows] + 0.02 * rng.normal(size=(len(rows), 2)),
        observation_cov=recording.observation_cov[rows],
        landmark=recording.landmark[rows],
    )


def assert_same(actual: Estimate, expected: Estimate) -> None:
    turn = between(actual.poses, expected.poses)
    np.testing.assert_allclose(turn, np.zeros_like(turn), rtol=0, atol=1e-9)
    for name in ("pose_covs", "landmark_ids", "landmarks", "landmark_covs", "nis", "nis_dof"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-9, atol=1e-9, err_msg=name)


# --- consistency ---------------------------------------------------------------------------------

RUNS = 30


@RELATIVES
def test_nis_and_nees_are_chi_square(estimator: Estimator) -> None:
    """With a heading uncertainty of 6 degrees, for which the textbook filter leaves the band."""
    sensor: Sensor = "range-bearing"
    runs = run_all(estimator, sensor, 0.1, RUNS)
    nees = np.asarray(sum(additive_nees(*run) for run in runs))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0
    assert outside(total_nis(runs), total_dof(runs), 1) == 0
    of_textbook = np.asarray(sum(additive_nees(*run) for run in run_all(ekf_slam, sensor, 0.1, RUNS)))
    assert outside(of_textbook, 3 * RUNS, STEPS + 1) > STEPS / 4


@pytest.mark.full  # 6 instead of 12 degrees are usual
def test_nees_of_sigma_points_in_invariant_coordinates_is_chi_square_for_an_uncertain_heading() -> None:
    """With 12 degrees the additive error is not Gaussian."""
    nees = np.asarray(sum(invariant_nees(*run) for run in run_all(riukf, "position", 0.2, RUNS)))
    assert outside(nees, 3 * RUNS, STEPS + 1) == 0


def total_nis(runs: list[tuple[Float, Estimate]]) -> Float:
    return np.array(sum(float(run.nis.sum()) for _, run in runs if run.nis is not None))


def total_dof(runs: list[tuple[Float, Estimate]]) -> int:
    dof = sum(int(run.nis_dof.sum()) for _, run in runs if run.nis_dof is not None)
    assert dof > 9_000
    return dof


@pytest.mark.parametrize("sigma", [1.0, 1e6])
def test_the_prior_covariance_never_changes_the_robocentric_estimate(sigma: float) -> None:
    """Observations do not depend on the world frame: an uncertain start changes no pose."""
    _, recording = random_recording(6, steps=60)
    doubtful = replace(recording, prior_cov=recording.prior_cov + np.diag([sigma, sigma, 0.3]) ** 2)
    sure, unsure = robocentric_ekf(recording), robocentric_ekf(doubtful)
    np.testing.assert_allclose(unsure.poses, sure.poses, rtol=0, atol=1e-12)
    if sigma > 1.0:
        with pytest.raises(UserError, match="too far apart"):
            ekf_slam(doubtful)
    else:
        assert np.abs(ekf_slam(doubtful).poses - ekf_slam(recording).poses).max() > 0.01


# --- soundness -----------------------------------------------------------------------------------


@BELIEFS
def test_covariance_stays_symmetric_and_positive_semi_definite(belief_of: BeliefOf) -> None:
    """1000 steps back and forth without slip from a fixed start: the covariance is singular at first."""
    slam = NumpyFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
    for k in back_and_forth(slam, 1000):
        if k % 100 == 0 or k > 990:
            eigenvalues = np.linalg.eigvalsh(slam.belief.cov)
            assert eigenvalues[0] > -1e-15 * eigenvalues[-1]
            assert np.array_equal(slam.belief.cov, slam.belief.cov.T)
    assert np.abs(between(slam.pose, np.zeros(3))).max() < 0.5


def test_a_landmark_at_the_robot() -> None:
    """Sigma points refuse it; the robocentric filter uses its range only."""
    sight = Observations(np.array([1]), np.array([[0.0, 0.3]]), np.diag([0.01, 0.01])[None])
    invariant, robocentric = (
        NumpyFilter("range-bearing", belief_of("range-bearing", np.zeros(3), np.zeros((3, 3))))
        for belief_of in (InvariantBelief, RobocentricBelief)
    )
    invariant.update(sight)
    with pytest.raises(UserError, match="no update exists"):
        invariant.update(sight)
    robocentric.update(sight)
    nis, dof = robocentric.update(sight)
    assert dof < 2
    assert np.isfinite(nis)
    assert np.isfinite(robocentric.landmarks).all()


# --- refusals ------------------------------------------------------------------------------------


@RELATIVES
def test_unsuitable_recordings_are_refused(estimator: Estimator) -> None:
    _, recording = random_recording(4)
    with pytest.raises(UserError, match=r"^sensor: 'bearing' does not fit this filter; use one of range-bearing"):
        estimator(bearing_only(recording))
    with pytest.raises(UserError, match=r"^landmark: this filter needs known association; give the ids"):
        estimator(replace(recording, landmark=None))
