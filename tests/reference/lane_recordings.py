"""Recordings of large maps with a small part in each scan."""

from __future__ import annotations

import numpy as np

from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation


def lanes(*, sensor: str = "range-bearing", slip: bool = True, lanes: int = 4, length: int = 30) -> Recording:
    """Simulate a drive in lanes: a scan observes landmarks within 2.5 m, so that neighbouring lanes share landmarks."""
    turns = np.zeros((lanes * length, 3))
    turns[:, 0] = 1.0
    for lane in range(1, lanes):
        turns[lane * length - 1 : lane * length + 1, 2] = np.pi / 2 if lane % 2 else -np.pi / 2
    turns[::length, 0] = 3.0
    path = chain(np.zeros(3), turns)
    rng = np.random.default_rng(0)
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    places = rng.uniform(low - 1.0, high + 1.0, (2 * len(path), 2))
    offset = places - path[:, None, :2]
    step, landmark = np.nonzero(np.abs(np.hypot(offset[..., 0], offset[..., 1]) - 1.5) < 1.0)
    delta = np.einsum("nji,nj->ni", rotation(path[step, 2]), offset[step, landmark])
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
    exact = {"range-bearing": polar, "position": delta, "bearing": polar[:, 1:]}[sensor]
    sigma = {"range-bearing": [0.1, 0.02], "position": [0.1, 0.1], "bearing": [0.02]}[sensor]
    return Recording(
        stamps=np.arange(len(path), dtype=np.float64),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([0.01, 0.01, 1e-4]),
        odometry=turns + rng.normal(size=turns.shape) * [0.02, 0.01 * slip, 0.005],
        odometry_cov=np.tile(np.diag([0.02, 0.01 * slip, 0.005]) ** 2, (len(turns), 1, 1)),
        sensor=sensor,  # pyright: ignore[reportArgumentType]
        observation_step=step,
        observation=exact + rng.normal(size=exact.shape) * sigma,
        observation_cov=np.tile(np.diag(sigma) ** 2, (len(step), 1, 1)),
        landmark=landmark,
    )
