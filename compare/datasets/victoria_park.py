"""The Victoria Park recording (ACFR, Sydney) in the text form that GTSAM distributes.

It is a graph with lines `ODOMETRY i j dx dy dtheta` and `LANDMARK i l x y`, each with the upper triangle of its
covariance: metres, radians, landmarks in the body frame.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from slamgauge.compare.datasets.g2o import FORMS, read_g2o
from slamgauge.compare.datasets.imported_log import require_max_range
from slamgauge.compare.storage.text_lines import read_tagged
from slamgauge.recording import Recording


def read_victoria_park(path: str | Path, *, max_range: float = math.inf) -> Recording:
    """Read a Victoria Park file: `position` sensor, association known, step k at k seconds.

    The first pose is the origin and fixed. The ids of poses increase along the path; some ids between are landmarks.

    Args:
        path: The text file.
        max_range: Observations of landmarks beyond this range [m] are dropped.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_max_range(max_range)
    reached: int | None = None
    for line in read_tagged(Path(path), {tag: FORMS[tag] for tag in ("ODOMETRY", "LANDMARK")})["ODOMETRY"]:
        start, end = line.id_at(1), line.id_at(2)
        if end <= start or reached not in (None, start):
            raise line.refused(f"leads from pose {start} to {end}, after pose {reached}", "sort the edges by ids")
        reached = end
    recording = read_g2o(Path(path)).recording
    return recording.only(np.hypot(*recording.observation.T) <= max_range)
