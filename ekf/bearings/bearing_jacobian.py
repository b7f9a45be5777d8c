"""How a bearing changes with the place of what is seen."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def bearing_gradient(offset: Float, scale: Float) -> Float:
    """Gradients (n, 2) of the directions of `offset` (n, 2): (-y, x) / scale.

    Args:
        offset: from the robot to the landmark.
        scale: (n,) the squared lengths, as far as the caller lets them be small, times whatever unit it counts in.
    """
    return np.column_stack([-offset[:, 1], offset[:, 0]]) / scale[:, None]
