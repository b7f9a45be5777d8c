"""How much larger a map is than the true one."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def too_large(landmarks: Float, true: Float) -> float:
    """By how much a map is larger than the true one [%]: the scale of the similarity that fits it best.

    Args:
        landmarks: (L, 2) [m].
        true: (L, 2) [m], the same landmarks.
    """
    found, right = (each[:, 0] + 1j * each[:, 1] for each in (landmarks, true))
    found, right = found - found.mean(), right - right.mean()
    return 100.0 * float(abs(np.vdot(right, found)) / np.vdot(right, right).real - 1.0)
