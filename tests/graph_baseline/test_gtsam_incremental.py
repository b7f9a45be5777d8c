"""GTSAM's fixed-lag smoother and iSAM2 compared with `causal`, the minimum of the exact cost at every step."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import BENCHED, entry_of
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, causal, fixed_lag, gtsam_incremental, isam2
from slamgauge.recording import Recording
from tests.reference.random_recordings import random_recording, recording_of
from tests.reference.small_problems import answer, pose_difference, sigmas_of


def largest_difference(found: Estimate, optimum: Estimate) -> float:
    """Return the largest difference of poses in standard deviations of the optimum."""
    return float(np.abs(pose_difference(found.poses, answer(optimum))).max())


@pytest.mark.parametrize("seed", range(4))
def test_a_window_of_all_steps_gives_the_causal_optimum(seed: int) -> None:
    """The difference is GTSAM's relinearisation threshold of 1 mm or 0.001 rad."""
    recording = recording_of("range-bearing", seed)
    long, short, optimum = fixed_lag(recording, lag=recording.steps), fixed_lag(recording, lag=1), causal(recording)
    assert largest_difference(long, optimum) < 0.005 < 0.2 < largest_difference(short, optimum)
    found, expected = answer(long), answer(optimum)
    np.testing.assert_allclose(np.diagonal(found.pose_covs[-1]), np.diagonal(expected.pose_covs[-1]), rtol=2e-3)
    np.testing.assert_array_equal(found.ids, expected.ids)
    np.testing.assert_allclose(found.landmarks, expected.landmarks, atol=1e-3)


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("lag", [1, 7])
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
def test_marginalisation_loses_nothing_if_noise_is_small(sensor: str, lag: int, slip: bool) -> None:
    _, recording = random_recording(3, sensor=sensor, noise=0.01, slip=slip)
    assert largest_difference(fixed_lag(recording, lag=lag), causal(recording)) < 0.05


def test_bearings_alone_are_refused_with_the_estimator_that_serves_instead() -> None:
    """Of windows of 5 to 20 steps the error of q4-three-landmarks was up to 11 times what the covariance states."""
    recording = simulate(load_scenario("q4-three-landmarks", ["trajectory.duration=2"]), 1)[1]
    with pytest.raises(UserError, match=r"^fixed_lag: .* is overconfident and diverges; use isam2 for this recording$"):
        fixed_lag(recording)


def test_the_name_of_the_estimator_contains_the_lag() -> None:
    _, recording = random_recording(0)
    loaded = load_estimators(["fixed-lag", "fixed-lag-3", "fixed-lag-999999999"])
    of_all = fixed_lag(recording, lag=recording.steps).poses
    np.testing.assert_array_equal(loaded["fixed-lag-999999999"](recording).poses, of_all)
    np.testing.assert_array_equal(loaded["fixed-lag"](recording).poses, fixed_lag(recording, lag=20).poses)
    np.testing.assert_array_equal(loaded["fixed-lag-3"](recording).poses, fixed_lag(recording, lag=3).poses)
    with_association = load_estimators(["fixed-lag-3@ekf"])["fixed-lag-3@ekf"]
    np.testing.assert_array_equal(
        with_association(recording).poses, fixed_lag(recording, ekf_slam(recording).association, lag=3).poses
    )
    for steps in ("x", "", "1e3", "007", "9" * 5000):
        with pytest.raises(UserError, match=f"'fixed-lag-{steps}' is not known"):
            load_estimators([f"fixed-lag-{steps}"])
    with pytest.raises(UserError, match="lag: 0 steps leave no window; give a whole number, at least 1"):
        load_estimators(["fixed-lag-0"])["fixed-lag-0"](recording)


@pytest.mark.parametrize("lag", [-1, 2.5, True, None, "5", float("nan")])
def test_an_invalid_lag_is_refused_in_one_line(lag: object) -> None:
    _, recording = random_recording(0, steps=2)
    with pytest.raises(UserError, match=rf"^lag: {lag!r} steps leave no window; give a whole number, at least 1$"):
        fixed_lag(recording, lag=lag)  # pyrefly: ignore[bad-argument-type]


def test_gtsams_error_about_an_indeterminate_system_becomes_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Real data cause it: for example bearings with 5 degrees noise and a window of 30, after some 265 steps."""

    def indeterminate(_: object) -> Float:
        raise RuntimeError("\nIndeterminate linear system detected while working near variable (Symbol: x0).")

    monkeypatch.setattr(gtsam_incremental, "pose_array", indeterminate)
    with pytest.raises(UndeterminedError, match=r"^pose 0: .*$"):
        fixed_lag(recording_of("range-bearing", 0), lag=3)


# --- iSAM2 ---------------------------------------------------------------------------------------


def relinearised_at_every_step(recording: Recording) -> Estimate:
    return isam2(recording, relinearize_threshold=0.0, relinearize_skip=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
def test_with_relinearisation_at_every_step_it_is_near_the_causal_optimum(seed: int, slip: bool) -> None:
    """The difference is one Gauss-Newton step: covariances are from before it, up to 4 % off in sigma."""
    recording = recording_of("range-bearing", seed, slip=slip)
    found, optimum = answer(relinearised_at_every_step(recording)), answer(causal(recording))
    assert np.abs(pose_difference(found.poses, optimum)).max() < 0.05
    np.testing.assert_allclose(sigmas_of(found.pose_covs), sigmas_of(optimum.pose_covs), rtol=0.05, atol=1e-9)
    np.testing.assert_array_equal(found.ids, optimum.ids)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["q1-short-dense", "q4-three-landmarks"])
def test_relinearisation_at_every_step_reduces_the_error(name: str) -> None:
    recording = simulate(load_scenario(name, ["start=sampled", "trajectory.duration=20"]), 1)[1]
    optimum = answer(causal(recording))
    near, usual = (
        np.sqrt(np.mean(np.abs(pose_difference(each.poses, optimum)).max(axis=1) ** 2))
        for each in (relinearised_at_every_step(recording), isam2(recording))
    )
    assert near < 0.01
    assert near < usual


def test_it_uses_no_measurement_of_the_future() -> None:
    recording, until = recording_of("range-bearing", 1), 14
    whole, cut = isam2(recording), isam2(recording.first(until))
    np.testing.assert_allclose(cut.poses, whole.poses[: until + 1], atol=1e-12)


def test_isam2_and_gtsam_batch_accept_associations_and_are_not_in_the_default_bench() -> None:
    for name, kind in (("isam2", "filtered"), ("gtsam-batch", "smoothed")):
        assert entry_of(name).takes_associations
        assert entry_of(name).kind == kind
        assert name not in BENCHED.split(",")
