"""Choice between the full and the compressed filter for a recording with many landmarks.

Both compute the same estimate, up to rounding. The faster one is chosen by the number of multiply-adds on the path and
map of dead reckoning, whose drift is negligible over the length of an area.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, distinct
from slamgauge.back_projection import positions_seen
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.sensors import SENSORS

FEW = 300  # landmarks; the covariance of a smaller map fits into the processor's caches and is never compressed
AREA = 1.5  # radius of an area, relative to the farthest observation
CLEARLY = 0.5  # the compressed filter is chosen if its share of the full filter's work is smaller
# Work of a step with its account, relative to the update of a map of the area alone.
ACCOUNT: dict[Correction, float] = {"standard": 4.0, "right-invariant": 9.0}
BASIS: dict[Correction, float] = {"standard": 1.0, "right-invariant": 2.0}  # rows of the account per entry of the area
COPIED = 270.0  # cost of updating one entry of the whole covariance when the robot leaves an area, in multiply-adds


def area_that_pays(recording: Recording, correction: Correction) -> float | None:
    """Return the radius [m] of areas with which a compressed filter is clearly faster than the full one, or None.

    Args:
        recording: known association; not bearing-only.
        correction: correction of the filter; without a compressed form there is no radius.
    """
    assert recording.landmark is not None
    if correction not in ACCOUNT or len(distinct(recording.landmark)) < FEW:
        return None
    radius = AREA * float(_distances(recording).max())
    full, compressed = work(recording, correction, radius)
    return radius if compressed < CLEARLY * full else None


def work(recording: Recording, correction: Correction, radius: float) -> tuple[float, float]:
    """Return the multiply-adds of the full filter, and of the compressed filter with areas of the given radius [m]."""
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
    """Return the measured distance [m] of each observation, (M,)."""
    z = recording.observation
    return z[:, 0] if SENSORS[recording.sensor].has_range else np.hypot(*z.T)


def _dead_reckoned(recording: Recording) -> tuple[Float, Int, Float, Int]:
    """Return the path (N+1, 3) and map (L, 2) of dead reckoning, the slot (M,) of each observation, and first steps.

    The order is path, slots, map, and the step (L,) of the first observation of each landmark.
    """
    assert recording.landmark is not None
    path = chain(recording.prior_mean, recording.odometry)
    _, first, slot = np.unique(recording.landmark, return_index=True, return_inverse=True)
    return path, slot, positions_seen(recording, first, path), recording.observation_step[first]
