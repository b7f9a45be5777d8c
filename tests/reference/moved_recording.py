"""The same run at another place in the world, and comparison of positions relative to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation

FAR = np.array([500_000.0, 4_600_000.0, 2.5])  # [m, m, rad]: UTM coordinates in southern Europe, and a rotation
TOLERANCE = 1e-6  # standard deviations


def moved(recording: Recording) -> Recording:
    """Move a run to another place: only the prior changes, because all measurements are relative."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(FAR[2])
    return replace(
        recording, prior_mean=compose(FAR, recording.prior_mean), prior_cov=turn @ recording.prior_cov @ turn.T
    )


def moved_back(positions: Float) -> Float:
    return (positions - FAR[:2]) @ rotation(FAR[2])


def assert_same_positions(far: Float, near: Float, covs: Float) -> None:
    assert len(near)
    sigmas = np.sqrt(np.linalg.eigvalsh(covs)[:, 0].clip(min=1e-8))
    off = np.hypot(*(moved_back(far) - near).T)
    assert (off / sigmas).max() < TOLERANCE
