"""Copies of filters in other processes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from slamgauge.ekf import SlamFilter
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.recording import Observations

VALUES, COVS = np.array([[3.0, 0.2], [2.0, -0.4]]), np.tile(np.eye(2) / 100, (2, 1, 1))


@pytest.mark.parametrize("correction", ["standard", "first-estimates", "right-invariant"])
def test_a_pickled_filter_continues_with_the_same_results(correction: Correction) -> None:
    def step(slam: SlamFilter) -> None:
        slam.predict(np.array([0.1, 0.0, 0.02]), np.diag([1e-4, 0.0, 1e-5]))
        slam.update(Observations(np.array([4, 2]), VALUES, COVS))

    slam = SlamFilter("range-bearing", np.zeros(3), np.eye(3) / 100, correction)
    step(slam)
    other = pickle.loads(pickle.dumps(slam))
    for each in (slam, other):
        step(each)
    np.testing.assert_array_equal(other.pose, slam.pose)
    np.testing.assert_array_equal(other.cov, slam.cov)
