"""Triangulation of a landmark, also far from the origin."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.se2 import wrap
from slamgauge.triangulation import triangulate

FAR = np.array([500_000.0, 4_600_000.0, 0.0])  # [m]: UTM coordinates of southern Europe


@pytest.mark.parametrize("sigma", [1e-11, 1e-4, 0.05])  # the smallest is below the resolution of doubles there
def test_triangulation_does_not_depend_on_the_origin(sigma: float) -> None:
    rng = np.random.default_rng(5)
    poses = np.column_stack([np.linspace(0, 4, 9), np.zeros(9), rng.uniform(-1, 1, 9)])  # exact sums
    offset = np.array([3.0, 9.0]) - poses[:, :2]
    bearings = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2] + sigma * rng.normal(size=9))
    near, far = (triangulate(each, bearings, np.full(9, sigma**2), 0.3) for each in (poses, poses + FAR))
    assert near.placed
    assert far.placed
    assert far.sigma == pytest.approx(near.sigma, rel=1e-8)
    assert far.landmark - FAR[:2] == pytest.approx(near.landmark, abs=1e-6 * near.sigma + 1e-8)


def test_a_single_bearing_far_from_the_origin_places_nothing() -> None:
    found = triangulate(FAR[None], np.zeros(1), np.ones(1), 0.3)
    assert not found.placed
    assert found.landmark == pytest.approx([500_001.0, 4_600_000.0])
