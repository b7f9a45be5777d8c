"""A transaction: the map is restored if an update in several parts is refused."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.validation import LARGEST


def is_addition_certain(landmarks: LandmarkMap) -> bool:
    """Return whether landmarks of sound observations have finite covariances, so that adding them is never refused."""
    return landmarks.state.variances.max() < LARGEST**2


@contextmanager
def transaction(landmarks: LandmarkMap, *, covariance: bool = True) -> Generator[None]:
    """Restore the map if the body of the `with` statement raises.

    Args:
        landmarks: the map.
        covariance: whether P may change before an error; a copy of P costs time on large maps.
    """
    state = landmarks.state
    belief, ids = state.belief, state.ids
    size = belief.size
    kept = size if covariance else 0
    entries, point, cov = belief.state[:size].copy(), belief.point[:size].copy(), belief.cov[:kept, :kept].copy()
    points = belief.points.copy()
    try:
        yield
    except BaseException:
        belief.state[:size], belief.point[:size], belief.cov[:kept, :kept] = entries, point, cov
        belief.points[:] = points
        state.belief = belief
        state.set_ids(ids)
        raise
