"""Observations do not change the pose covariance of a robot that stands still (Julier and Uhlmann, ICRA 2001)."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge import load_estimators, load_scenario, simulate
from slamgauge.arrays import Float

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def covariances() -> dict[str, Float]:
    """Return pose covariances (1001, 3, 3) of each filter on the shipped scenario."""
    _, recording = simulate(load_scenario("stationary"), 0)
    assert len(np.unique(recording.observation_step)) == 1001
    found: dict[str, Float] = {}
    for name, estimator in load_estimators(["ekf", "fej-ekf", "oc-ekf", "iekf", "riekf"]).items():
        covs = estimator(recording).pose_covs
        assert covs is not None
        found[name] = covs
    return found


@pytest.mark.parametrize("name", ["fej-ekf", "oc-ekf", "riekf"])
def test_the_pose_covariance_of_a_consistent_filter_is_constant(covariances: dict[str, Float], name: str) -> None:
    prior = covariances[name][0]
    sigmas = np.sqrt(np.diag(prior))
    np.testing.assert_allclose((covariances[name] - prior) / np.outer(sigmas, sigmas), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["ekf", "iekf"])
def test_the_heading_variance_of_the_other_filters_falls(covariances: dict[str, Float], name: str) -> None:
    heading = covariances[name][:, 2, 2]
    assert heading[-1] < 0.9 * heading[0]
    assert (np.diff(heading) <= 1e-15).all()
