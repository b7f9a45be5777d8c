"""GTSAM's iSAM2 compared with `causal`, which computes the same poses at the minimum of the exact cost."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge import causal, isam2, load_scenario, simulate
from slamgauge.compare.estimators.registry import BENCHED, entry_of
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.random_recordings import recording_of
from tests.reference.small_problems import answer, pose_difference, sigmas_of

pytestmark = pytest.mark.slow


def relinearised_at_every_step(recording: Recording) -> Estimate:
    return isam2(recording, relinearize_threshold=0.0, relinearize_skip=1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
def test_with_relinearisation_at_every_step_it_is_near_the_causal_optimum(seed: int, slip: bool) -> None:
    """The difference is one Gauss-Newton step: covariances are from before it, up to 4 % off in sigma."""
    recording = recording_of("range-bearing", seed, slip=slip)
    found, optimum = answer(relinearised_at_every_step(recording)), answer(causal(recording))
    assert np.abs(pose_difference(found.poses, optimum)).max() < 0.05
    np.testing.assert_allclose(sigmas_of(found.pose_covs), sigmas_of(optimum.pose_covs), rtol=0.05, atol=1e-9)
    np.testing.assert_array_equal(found.ids, optimum.ids)


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
