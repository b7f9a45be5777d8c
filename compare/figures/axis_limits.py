"""Axis limits that ignore diverged estimators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slamgauge.arrays import Float

DIVERGED = 5.0  # an extent above this multiple of the median is ignored
DIVERGED_LOG = 100.0  # the same for logarithmic axes


def robust_limits(extents: Mapping[str, Float], factor: float = DIVERGED) -> tuple[Float, list[str]]:
    """Return heights (K,) of K panels without the diverged estimators, and the names of these.

    Args:
        extents: Largest value (K,) of each estimator in each panel, not negative.
        factor: Largest extent that counts, as a multiple of the median.
    """
    rows = np.array([*extents.values()])
    typical = np.sort(rows, axis=0)[(len(rows) - 1) // 2]
    counts = rows <= factor * typical
    heights = np.where(counts, rows, 0.0).max(axis=0)
    return heights, [name for name, row in zip(extents, counts, strict=True) if not row.all()]


def exceeding(names: list[str]) -> str:
    """Return a remark about the estimators whose curves exceed the axes; empty without names."""
    return f"{', '.join(names)} exceed{'s' * (len(names) == 1)} the axes" if names else ""
