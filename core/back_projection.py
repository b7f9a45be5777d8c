"""Where observations put what they see."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.se2 import compose


def positions_seen(recording: Recording, rows: Int, path: Float) -> Float:
    """Positions (n, 2) [m], world frame, of what these rows of the observations see from a path (N+1, 3).

    Bearings alone put it at a metre's distance.
    """
    seen = recording.observation[rows]
    if recording.sensor != "position":
        distance = seen[:, 0] if recording.sensor == "range-bearing" else 1.0
        seen = (distance * np.array([np.cos(seen[:, -1]), np.sin(seen[:, -1])])).T
    poses = path[recording.observation_step[rows]]
    return compose(poses, np.column_stack([seen, np.zeros(len(seen))]))[:, :2]
