"""Wherever in the world a run takes place, its optima relative to the start are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, robust_batch
from slamgauge.se2 import wrap
from tests.reference.elsewhere import FAR, TOLERANCE, assert_same_positions, moved
from tests.reference.random_recordings import random_recording


@pytest.mark.parametrize("optimum", [batch, causal, robust_batch])
@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
@pytest.mark.parametrize("slip", [True, False])
def test_optima(optimum: Callable[..., Estimate], sensor: str, slip: bool) -> None:
    drawn = "range-bearing" if sensor == "bearing" else sensor
    _, recording = random_recording(30, sensor=drawn, steps=60, noise=0.5, slip=slip)
    if sensor == "bearing":
        bearings, covs = recording.observation[:, 1:], recording.observation_cov[:, 1:, 1:]
        recording = replace(recording, sensor=sensor, observation=bearings, observation_cov=covs)
    far, near = optimum(moved(recording)), optimum(recording)
    assert near.pose_covs is not None
    assert far.pose_covs is not None
    assert_same_positions(far.poses[:, :2], near.poses[:, :2], near.pose_covs[:, :2, :2])
    turned = wrap(far.poses[:, 2] - near.poses[:, 2] - FAR[2])
    assert (np.abs(turned) < TOLERANCE * np.sqrt(near.pose_covs[:, 2, 2])).all()
    np.testing.assert_allclose(
        np.linalg.eigvalsh(far.pose_covs[:, :2, :2]), np.linalg.eigvalsh(near.pose_covs[:, :2, :2]), rtol=1e-5
    )
    np.testing.assert_array_equal(far.landmark_ids, near.landmark_ids)
    np.testing.assert_array_equal(far.association, near.association)
    assert near.landmarks is not None
    assert far.landmarks is not None
    assert near.landmark_covs is not None
    assert_same_positions(far.landmarks, near.landmarks, near.landmark_covs)
