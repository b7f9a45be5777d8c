"""Optima relative to the start do not depend on the position and heading of the start."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, robust_batch
from slamgauge.se2 import rotation, wrap
from tests.reference.moved_recording import FAR, TOLERANCE, assert_same_positions, moved
from tests.reference.random_recordings import recording_of


@pytest.mark.parametrize("optimum", [batch, causal, robust_batch])
@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
@pytest.mark.parametrize("slip", [True, False])
def test_optima(optimum: Callable[..., Estimate], sensor: str, slip: bool) -> None:
    recording = recording_of(sensor, 30, steps=60, noise=0.5, slip=slip)
    far, near = optimum(moved(recording)), optimum(recording)
    assert near.pose_covs is not None
    assert far.pose_covs is not None
    assert_same_positions(far.poses[:, :2], near.poses[:, :2], near.pose_covs[:, :2, :2])
    turned = wrap(far.poses[:, 2] - near.poses[:, 2] - FAR[2])
    assert (np.abs(turned) < TOLERANCE * np.sqrt(near.pose_covs[:, 2, 2])).all()
    turn = np.eye(3)
    turn[:2, :2] = rotation(FAR[2])
    scale = np.sqrt(np.trace(near.pose_covs, axis1=1, axis2=2))[:, None, None]
    np.testing.assert_allclose(far.pose_covs / scale**2, turn @ near.pose_covs @ turn.T / scale**2, rtol=0, atol=1e-5)
    variances, expected = (np.linalg.eigvalsh(each[:, :2, :2]) for each in (far.pose_covs, near.pose_covs))
    np.testing.assert_allclose(variances, expected, rtol=1e-5)
    np.testing.assert_array_equal(far.landmark_ids, near.landmark_ids)
    np.testing.assert_array_equal(far.association, near.association)
    assert near.landmark_covs is not None
    assert_same_positions(far.landmarks, near.landmarks, near.landmark_covs)
