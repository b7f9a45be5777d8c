"""Recordings of a straight path, and hand-made paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import chain


def straight(steps: int = 4, seen: list[tuple[int, int]] | None = None, dt: float = 1.0) -> Recording:
    """Return a recording of 1 m along x per step; `seen` has (step, landmark id) in order of time."""
    at, ids = np.array(seen or [], dtype=int).reshape(-1, 2).T
    count = len(at)
    return Recording(
        stamps=np.linspace(0, steps * dt, steps + 1),
        prior_mean=np.zeros(3),
        prior_cov=np.eye(3),
        odometry=np.tile([1.0, 0.0, 0.0], (steps, 1)),
        odometry_cov=np.tile(np.eye(3), (steps, 1, 1)),
        sensor="range-bearing",
        observation_step=at,
        observation=np.tile([1.0, 0.0], (count, 1)),
        observation_cov=np.tile(np.eye(2), (count, 1, 1)),
        landmark=ids,
    )


def path(recording: Recording, offset: ArrayLike = 0) -> Float:
    """Return the poses of the odometry, plus an offset."""
    return chain(recording.prior_mean, recording.odometry) + np.asarray(offset)
