"""Maps of filters: copies in other processes, types of ids."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from slamgauge.arrays import Int
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


@pytest.mark.parametrize("kind", [np.uint8, np.uint64, np.int32])
def test_ids_may_be_whole_numbers_of_any_kind(kind: type[np.generic]) -> None:
    slam = SlamFilter("range-bearing", np.zeros(3), np.eye(3) / 100)
    ids: Int = np.array([4, 2], dtype=kind)  # pyrefly: ignore[bad-assignment]
    for values in (VALUES, VALUES, VALUES + 5.0):
        slam.update(Observations(ids, values, COVS), gate=9.0)
    assert slam.landmark_ids.tolist() == [4, 2]
    assert slam.associated.tolist() == [-1, -1]
