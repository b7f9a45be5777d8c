"""What an estimate may be."""

from __future__ import annotations

import math

import numpy as np
from vocabulary_examples import estimate

from slamgauge.estimate import Estimate


def test_an_estimate_needs_only_kind_and_poses() -> None:
    least = Estimate(kind="smoothed", poses=np.zeros((3, 3)))
    assert (least.landmark_ids.shape, least.landmarks.shape) == ((0,), (0, 2))
    assert least.pose_covs is None
    assert least.association is None


def test_headings_of_an_estimate_are_wrapped() -> None:
    np.testing.assert_allclose(
        estimate(poses=[[0, 0, 7.0], [0, 0, -math.pi], [0, 0, math.pi]]).poses[:, 2],
        [7 - 2 * math.pi, math.pi, math.pi],
    )
