"""Which filter a recording with many landmarks is better served by: the full one, or the compressed one.

Both give the same estimate, to rounding. Which takes less time is told by their multiply-adds, along the path and on
the map that dead reckoning makes: areas are small beside its drift's length.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, distinct
from slamgauge.back_projection import positions_seen
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.sensors import SENSORS

FEW = 300  # landmarks of a map that the caches hold: it is never compressed
AREA = 1.5  # radius of an area over the farthest sight
CLEARLY = 0.5  # of the full filter's work: less is worth another program
ACCOUNT: dict[Correction, float] = {"standard": 4.0, "right-invariant": 9.0}  # work of a step with that of its area
BASIS: dict[Correction, float] = {
    "standard": 1.0,
    "right-invariant": 2.0,
}  # rows of an account for an entry of its area
COPIED = 270.0  # multiply-adds in the time in which settling touches an entry of the covariance


def area_that_pays(recording: Recording, correction: Correction) -> float | None:
    """Radius [m] of the areas with which a compressed filter does clearly less work than the full one, if any.

    Args:
        recording: known association; not of bearings alone.
        correction: that of the filter; some have no compressed form.
    """
    assert recording.landmark is not None
    if correction not in ACCOUNT or len(distinct(recording.landmark)) < FEW:
        return None
    radius = AREA * float(_distances(recording).max())
    full, compressed = work(recording, correction, radius)
    return radius if compressed < CLEARLY * full else None


def work(recording: Recording, correction: Correction, radius: float) -> tuple[float, float]:
    """Multiply-adds of the full filter, and of the compressed one with areas of a radius [m]."""
    path, slot, positions, mapped = _dead_reckoned(recording)
    first = np.searchsorted(recording.observation_step, np.arange(recording.steps + 2))
    rows = recording.observation.shape[1] * np.diff(first)
    sizes = 3.0 + 2.0 * np.searchsorted(np.sort(mapped), np.arange(recording.steps + 1), side="right")
    full = float((rows * np.square(sizes)).sum()) / 2.0
    compressed, entry, area, entered = 0.0, path[0], np.zeros(len(positions), dtype=bool), -1
    for k in np.flatnonzero(rows).tolist():
        seen = slot[first[k] : first[k + 1]]
        outside = (mapped[seen] <= entered) & ~area[seen]
        if outside.any() or np.hypot(*(path[k] - entry)[:2]) > radius / 3.0:
            compressed += (2.0 * BASIS[correction] * area.sum() + COPIED) * sizes[k - 1] ** 2
            entry, entered = path[k], k - 1
            area = (mapped <= entered) & (np.hypot(*(positions - entry[:2]).T) <= radius)
            area[seen] |= mapped[seen] <= entered
        inside = 3.0 + 2.0 * (area.sum() + ((mapped > entered) & (mapped <= k)).sum())
        compressed += ACCOUNT[correction] * rows[k] * inside**2 / 2.0
    return full, compressed


def _distances(recording: Recording) -> Float:
    """(M,) [m] of the landmarks from the robot."""
    z = recording.observation
    return z[:, 0] if SENSORS[recording.sensor].has_range else np.hypot(*z.T)


def _dead_reckoned(recording: Recording) -> tuple[Float, Int, Float, Int]:
    """Path (N+1, 3), landmark (M,) of each observation, their places (L, 2), and the steps (L,) that saw them first."""
    assert recording.landmark is not None
    path = chain(recording.prior_mean, recording.odometry)
    _, first, slot = np.unique(recording.landmark, return_index=True, return_inverse=True)
    return path, slot, positions_seen(recording, first, path), recording.observation_step[first]
