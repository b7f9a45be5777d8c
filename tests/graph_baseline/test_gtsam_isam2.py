"""GTSAM's iSAM2 compared with `causal`, which computes the same poses at the minimum of the exact cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import causal, isam2, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import BENCHED, entry_of
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording, recording_of


def apart(found: Estimate, optimum: Estimate) -> Float:
    """(N+1,) largest difference of each pose, in standard deviations of the optimum."""
    assert optimum.pose_covs is not None
    off, sigma = found.poses - optimum.poses, np.sqrt(np.diagonal(optimum.pose_covs, axis1=1, axis2=2))
    off[:, 2] = wrap(off[:, 2])
    return np.max(np.abs(off) / np.where(sigma > 1e-9, sigma, np.inf), axis=1)


def tight(recording: Recording) -> Estimate:
    """iSAM2 that relinearises everything at every step."""
    return isam2(recording, relinearize_threshold=0.0, relinearize_skip=1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
def test_with_tight_settings_it_is_the_causal_optimum(seed: int, slip: bool) -> None:
    """But for one Gauss-Newton step: its matrices are those before the scan, up to 4 % off in standard deviations."""
    recording = recording_of("range-bearing", seed, slip=slip)
    found, optimum = tight(recording), causal(recording)
    assert apart(found, optimum).max() < 0.05
    assert found.pose_covs is not None and optimum.pose_covs is not None
    variances = [np.diagonal(each, axis1=1, axis2=2) for each in (found.pose_covs, optimum.pose_covs)]
    np.testing.assert_allclose(np.sqrt(variances[0] / variances[1]), 1.0, atol=0.05)
    np.testing.assert_array_equal(found.landmark_ids, np.sort(optimum.landmark_ids))


@pytest.mark.parametrize("name", ["q1-short-dense", "q4-three-landmarks"])
def test_tighter_settings_come_nearer_to_the_causal_optimum(name: str) -> None:
    """20 s of the scenario."""
    recording = simulate(load_scenario(name, ["start=sampled", "trajectory.duration=20"]), 1)[1]
    optimum, found = causal(recording), tight(recording)
    near, usual = (np.sqrt(np.mean(apart(each, optimum) ** 2)) for each in (found, isam2(recording)))
    assert near < 0.01
    assert near < usual


def test_no_measurement_of_the_future_is_used() -> None:
    recording, until = recording_of("range-bearing", 1), 14
    whole, cut = isam2(recording), isam2(recording.first(until))
    np.testing.assert_allclose(cut.poses, whole.poses[: until + 1], atol=1e-12)


def test_given_associations_replace_ids_also_under_a_filter() -> None:
    _, recording = random_recording(1)
    assert recording.landmark is not None
    given = np.where(np.arange(len(recording.landmark)) % 4 == 0, -1, recording.landmark)
    np.testing.assert_array_equal(isam2(replace(recording, landmark=None), given).association, given)
    with pytest.raises(UserError, match="the graph needs known association"):
        isam2(replace(recording, landmark=None))
    under = load_estimators(["isam2@ekf"])["isam2@ekf"]
    np.testing.assert_array_equal(under(recording).poses, isam2(recording, ekf_slam(recording).association).poses)


def test_bearing_only_landmarks_wait_until_they_are_placed() -> None:
    recording = recording_of("bearing", 0)
    assert recording.landmark is not None
    ids = recording.landmark.copy()
    ids[len(ids) // 2] = 999
    found = isam2(replace(recording, landmark=ids))
    assert found.association is not None
    assert 999 not in found.landmark_ids
    assert set(found.association[found.association >= 0]) == {*found.landmark_ids.tolist()}


def test_both_names_are_graphs_that_no_bench_measures_unless_told() -> None:
    for name, kind in (("isam2", "filtered"), ("gtsam-batch", "smoothed")):
        assert entry_of(name).takes_associations
        assert entry_of(name).kind == kind
        assert name not in BENCHED.split(",")
