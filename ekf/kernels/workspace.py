"""The arrays that an update works in, allocated once and used again at every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.deferred_downdate import Waiting, allocate_waiting

# Rows of `Workspace.scratch` by what they hold; names that share a row are never needed at once.
CORRECTION = 0  # dx, from an update until the state has moved
BLOCK_CORRECTION = 1  # the share of one block in dx
PLACE = 1  # where an iterated update takes its Jacobians
ANCHOR = 1  # the state at which the rows of W were formed (see `one_by_one`)
MOVE = 1  # u of T = I + u e_theta' (see `corrections`)
MOVE_FROM_ANCHOR = 0  # the same u, from the anchor to the state
WAY_BACK = 2  # from PLACE to the prior
HEADING_ROW = 2  # P e_theta
PLACE_OF_ONE = 2  # as PLACE, for one observation of `one_by_one`
MOVE_OF_ONE = 2  # as MOVE, for one observation of `one_by_one`
ROWS = 3


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
    scratch: Float  # (ROWS, capacity)
    waiting: Waiting  # of the belief that is worked on


def allocate(observations: int, capacity: int, block: int, waiting: Waiting | None = None) -> Workspace:
    """Room for `observations`, at most `block` of them at a time, in a state of up to `capacity` entries.

    No update waits unless there is room for it in `waiting`.
    """
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
        scratch=np.zeros((ROWS, capacity)),
        waiting=waiting or allocate_waiting(1, 0, capacity),
    )
