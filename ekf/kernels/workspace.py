"""Arrays of an update, allocated once and reused at every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.deferred_downdate import Deferred, allocate_deferred


class Workspace(NamedTuple):
    """Arrays for a scan of up to m observations, updated in blocks of up to b observations.

    The caller of an update fills `slots`, `observation` and `observation_cov`. The update overwrites all other arrays
    and returns its results as views of them (see `linearisation.Linearised`, `joint_update.Gain`).
    """

    ids: Int  # (m,)
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    jacobian: Float  # (2m, 5)
    innovation: Float  # (2m,)
    S: Float  # (2b, 2b)
    W: Float  # (2b, capacity)
    deferred: Deferred  # deferred downdates of the belief


def allocate(observations: int, capacity: int, block: int, deferred: Deferred | None = None) -> Workspace:
    """Allocate arrays for `observations`, updated in blocks of at most `block`, and a state of `capacity` entries.

    Without `deferred`, updates defer no downdates.
    """
    rows, block_rows = 2 * observations, 2 * min(observations, block)
    return Workspace(
        ids=np.zeros(observations, dtype=np.int64),
        slots=np.zeros(observations, dtype=np.int64),
        observation=np.zeros((observations, 2)),
        observation_cov=np.tile(np.eye(2), (observations, 1, 1)),  # the first row is constant for a bearing-only sensor
        jacobian=np.zeros((rows, 5)),
        innovation=np.zeros(rows),
        S=np.zeros((block_rows, block_rows)),
        W=np.zeros((block_rows, capacity)),
        deferred=allocate_deferred(1, 0, capacity) if deferred is None else deferred,
    )
