"""Landmark positions from single observations."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.se2 import compose
from slamgauge.sensors import inverse


def positions_seen(recording: Recording, rows: Int, path: Float) -> Float:
    """Return positions (n, 2) [m], world frame, of the landmarks that the observations `rows` see from a path (N+1, 3).

    A bearing without a range puts its landmark at a distance of 1 m.
    """
    seen = inverse(recording.sensor, recording.observation[rows])
    poses = path[recording.observation_step[rows]]
    return compose(poses, np.column_stack([seen, np.zeros(len(seen))]))[:, :2]
