"""The fixed-lag smoother: the causal optimum where its window holds everything, or where all is nearly linear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam, sliding_window
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, causal, fixed_lag
from slamgauge.graph_baseline.gtsam_fixed_lag import FixedLagSmoother
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording, recording_of


def apart(one: Estimate, other: Estimate) -> float:
    """The largest difference of poses, in sigmas of the other."""
    assert other.pose_covs is not None
    off = one.poses - other.poses
    off[:, 2] = wrap(off[:, 2])
    return float(np.max(np.abs(off) / np.sqrt(np.diagonal(other.pose_covs, axis1=1, axis2=2))))


@pytest.mark.parametrize("seed", range(4))
def test_a_window_that_holds_everything_is_the_causal_optimum(seed: int) -> None:
    """But for what has moved by less than a millimetre or 0.001 rad, which GTSAM leaves linearised where it was."""
    recording = recording_of("range-bearing", seed)
    smoothed, short, optimum = fixed_lag(recording, lag=recording.steps), fixed_lag(recording, lag=1), causal(recording)
    assert apart(smoothed, optimum) < 0.005 < 0.2 < apart(short, optimum)
    assert smoothed.pose_covs is not None
    assert optimum.pose_covs is not None
    ours, theirs = (np.diagonal(each[-1]) for each in (smoothed.pose_covs, optimum.pose_covs))
    np.testing.assert_allclose(ours, theirs, rtol=2e-3)
    np.testing.assert_array_equal(smoothed.landmark_ids, np.sort(optimum.landmark_ids))
    order = np.argsort(optimum.landmark_ids)
    np.testing.assert_allclose(smoothed.landmarks, optimum.landmarks[order], atol=1e-3)


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("lag", [1, 7])
def test_where_noise_vanishes_nothing_is_lost_by_what_is_marginalised(sensor: str, lag: int) -> None:
    for slip in (True, False):
        _, recording = random_recording(3, sensor=sensor, noise=0.01, slip=slip)
        assert apart(fixed_lag(recording, lag=lag), causal(recording)) < 0.05


def test_bearings_wait_until_the_window_places_their_landmark() -> None:
    recording = simulate(load_scenario("q4-three-landmarks", ["start=sampled", "trajectory.duration=12"]), 1)[1]
    assert recording.landmark is not None
    short, long = (fixed_lag(recording, lag=lag) for lag in (1, 60))
    assert len(short.landmark_ids) < len(long.landmark_ids) == 3
    assert long.association is not None
    assert set(long.association[long.association >= 0]) == {*long.landmark_ids.tolist()}
    assert apart(long, causal(recording)) < apart(short, causal(recording))


def test_names_say_how_long_the_lag_is() -> None:
    _, recording = random_recording(0)
    loaded = load_estimators(["fixed-lag", "fixed-lag-3"])
    np.testing.assert_array_equal(loaded["fixed-lag"](recording).poses, fixed_lag(recording, lag=20).poses)
    np.testing.assert_array_equal(loaded["fixed-lag-3"](recording).poses, fixed_lag(recording, lag=3).poses)
    under = load_estimators(["fixed-lag-3@ekf"])["fixed-lag-3@ekf"]
    np.testing.assert_array_equal(
        under(recording).poses, fixed_lag(recording, ekf_slam(recording).association, lag=3).poses
    )
    for steps in ("x", "", "1e3", "007", "9" * 5000):
        with pytest.raises(UserError, match=f"'fixed-lag-{steps}' is not known"):
            load_estimators([f"fixed-lag-{steps}"])
    with pytest.raises(UserError, match="lag: 0 steps leave no window; give a whole number, at least 1"):
        load_estimators(["fixed-lag-0"])["fixed-lag-0"](recording)


@pytest.mark.parametrize("lag", [-1, 2.5, True, None, "5", float("nan")])
def test_what_is_no_number_of_steps_is_refused_in_one_line(lag: object) -> None:
    _, recording = random_recording(0, steps=2)
    with pytest.raises(UserError, match=rf"^lag: {lag!r} steps leave no window; give a whole number, at least 1$"):
        fixed_lag(recording, lag=lag)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("smoother", [fixed_lag, sliding_window])
def test_a_lag_may_be_numpys_number_and_longer_than_any_recording(smoother: Callable[..., Estimate]) -> None:
    _, recording = random_recording(0)
    of_three, of_all = smoother(recording, lag=3), smoother(recording, lag=recording.steps)
    np.testing.assert_array_equal(smoother(recording, lag=np.int64(3)).poses, of_three.poses)
    np.testing.assert_array_equal(smoother(recording, lag=10**400).poses, of_all.poses)


def test_given_associations_stand_in_for_ids() -> None:
    _, recording = random_recording(1)
    assert recording.landmark is not None
    given = np.where(np.arange(len(recording.landmark)) % 4 == 0, -1, recording.landmark)
    estimate = fixed_lag(replace(recording, landmark=None), given)
    np.testing.assert_array_equal(estimate.association, given)
    with pytest.raises(UserError, match="the graph needs known association"):
        fixed_lag(replace(recording, landmark=None))


def test_what_becomes_indeterminate_is_named_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """So it is after some 265 steps of bearings of 5 degrees with a window of 30."""

    def indeterminate(_: FixedLagSmoother, step: int) -> Float:
        raise RuntimeError(f"\nIndeterminate linear system detected while working near variable (Symbol: x{step}).")

    monkeypatch.setattr(FixedLagSmoother, "_pose", indeterminate)
    with pytest.raises(UndeterminedError, match=r"^pose 0: .*$"):
        fixed_lag(recording_of("range-bearing", 0), lag=3)
