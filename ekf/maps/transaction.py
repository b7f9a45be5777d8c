"""Nothing or all: what a refused update has begun is undone."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from slamgauge.ekf.kernels.rounding_limits import LARGEST
from slamgauge.ekf.maps.landmark_map import LandmarkMap


def is_addition_certain(landmarks: LandmarkMap) -> bool:
    """Whether landmarks that sound observations add have finite covariances, so that adding them is never refused."""
    return landmarks.variances.max() < LARGEST**2


@contextmanager
def undone_if_refused(landmarks: LandmarkMap, *, covariance: bool = True) -> Generator[None]:
    """Leave the belief and the map as they were if what is done to them within raises.

    Args:
        landmarks: the map.
        covariance: whether P may have changed by then; to keep a copy costs time on large maps.
    """
    belief, ids, size = landmarks.belief, landmarks.ids, landmarks.belief.size
    kept = size if covariance else 0
    state, point, cov = belief.state[:size].copy(), belief.point[:size].copy(), belief.cov[:kept, :kept].copy()
    points = belief.points.copy()
    try:
        yield
    except BaseException:
        belief.state[:size], belief.point[:size], belief.cov[:kept, :kept] = state, point, cov
        belief.points[:] = points
        landmarks.belief = belief
        landmarks.name(ids)
        raise
