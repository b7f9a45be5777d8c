"""Optima relative to the start do not depend on the position and heading of the start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, robust_batch
from slamgauge.recording import Recording
from slamgauge.se2 import compose, pose_rotation, rotation, wrap
from tests.reference.random_recordings import recording_of

FAR = np.array([500_000.0, 4_600_000.0, 2.5])  # [m, m, rad]: UTM coordinates in southern Europe, and a rotation
TURN = pose_rotation(FAR[2])
TOLERANCE = 1e-6  # standard deviations


def moved(recording: Recording) -> Recording:
    """Move a run to another place: only the prior changes, because all measurements are relative."""
    return replace(
        recording, prior_mean=compose(FAR, recording.prior_mean), prior_cov=TURN @ recording.prior_cov @ TURN.T
    )


def assert_same_positions(far: Float, near: Float, covs: Float) -> None:
    assert len(near)
    sigmas = np.sqrt(np.linalg.eigvalsh(covs)[:, 0].clip(min=1e-8))
    off = np.hypot(*((far - FAR[:2]) @ rotation(FAR[2]) - near).T)
    assert (off / sigmas).max() < TOLERANCE


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
    scale = np.sqrt(np.trace(near.pose_covs, axis1=1, axis2=2))[:, None, None]
    np.testing.assert_allclose(far.pose_covs / scale**2, TURN @ near.pose_covs @ TURN.T / scale**2, rtol=0, atol=1e-5)
    variances, expected = (np.linalg.eigvalsh(each[:, :2, :2]) for each in (far.pose_covs, near.pose_covs))
    np.testing.assert_allclose(variances, expected, rtol=1e-5)
    np.testing.assert_array_equal(far.landmark_ids, near.landmark_ids)
    np.testing.assert_array_equal(far.association, near.association)
    assert near.landmark_covs is not None
    assert_same_positions(far.landmarks, near.landmarks, near.landmark_covs)
