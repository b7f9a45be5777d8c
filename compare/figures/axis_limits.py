"""Limits of panels that one who has gone astray does not squash."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slamgauge.arrays import Float

ASTRAY = 5.0  # times the median's extent: who has more leaves the panel
ASTRAY_ON_LOGARITHMS = 100.0  # where there is room for two decades


def robust_limits(extents: Mapping[str, Float], astray: float = ASTRAY) -> tuple[Float, list[str]]:
    """Heights (K,) of K panels that hold the extents (K,) of most, and the names of those who leave any.

    Args:
        extents: the largest figure of each name in each panel, not negative.
        astray: how many times the median's an extent may be.
    """
    rows = np.array([*extents.values()])
    typical = np.sort(rows, axis=0)[(len(rows) - 1) // 2]
    stays = rows <= astray * typical
    heights = np.where(stays, rows, 0.0).max(axis=0)
    return heights, [name for name, kept in zip(extents, stays, strict=True) if not kept.all()]


def leaving(names: list[str], what: str = "panel") -> list[str]:
    """What is said of those who leave: nothing, or a line."""
    return [f"{', '.join(names)} leave{'s' * (len(names) == 1)} the {what}"] * bool(names)
