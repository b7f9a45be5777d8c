"""The Victoria Park recording (ACFR, Sydney) in the text form that GTSAM distributes.

It is a graph with lines `ODOMETRY i j dx dy dtheta` and `LANDMARK i l x y`, each with the upper triangle of its
covariance: metres, radians, landmarks in the body frame.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.imported_log import require_max_range
from slamgauge.errors import UserError
from slamgauge.recording import Recording


def read_victoria_park(path: str | Path, *, max_range: float = math.inf) -> Recording:
    """Read a Victoria Park file: `position` sensor, association known, step k at k seconds.

    The first pose is the origin and fixed.

    Args:
        path: The text file.
        max_range: Observations of landmarks beyond this range [m] are dropped.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_max_range(max_range)
    recording = read_g2o(Path(path)).recording
    if recording.sensor != "position":
        raise UserError(f"{path}: no LANDMARK line in it; give the Victoria Park text file")
    return recording.only(np.hypot(*recording.observation.T) <= max_range)
