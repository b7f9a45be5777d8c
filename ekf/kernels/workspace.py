"""The arrays that an update works in, allocated once and used again at every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int

Marks = NDArray[np.bool_]


class Workspace(NamedTuple):
    """Arrays that an update reads and fills: m observations, taken in b at a time, `capacity` state entries."""

    ids: Int  # (m,)
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    jacobian: Float  # (2m, 5)
    innovation: Float  # (2m,)
    S: Float  # (2b, 2b)
    W: Float  # (2b, capacity)
    scratch: Float  # (3, capacity)
    points: Marks  # (capacity // 2,) which slots hold a position in the plane, that turns with the map


def allocate(observations: int, capacity: int, block: int) -> Workspace:
    """Room for `observations`, at most `block` of them at a time, in a state of up to `capacity` entries."""
    rows, block_rows = 2 * observations, 2 * min(observations, block)
    return Workspace(
        ids=np.zeros(observations, dtype=np.int64),
        slots=np.zeros(observations, dtype=np.int64),
        observation=np.zeros((observations, 2)),
        observation_cov=np.tile(np.eye(2), (observations, 1, 1)),  # a bearing's first row stays as it is
        jacobian=np.zeros((rows, 5)),
        innovation=np.zeros(rows),
        S=np.zeros((block_rows, block_rows)),
        W=np.zeros((block_rows, capacity)),
        scratch=np.zeros((3, capacity)),
        points=np.ones(capacity // 2, dtype=np.bool_),
    )
