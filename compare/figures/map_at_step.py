"""Map of an estimate at a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate

EQUAL = 1e-9  # weights that differ by less count as equal


class MapRows(NamedTuple):
    """Rows of a `MapHistory` at one step; each is a point or a member of a ray.

    Attributes:
        landmark: Landmark ids (K,).
        member: Numbers (K,) of the members along their ray, -1 for a point.
        weight: Probabilities (K,) of the members, 1 for a point.
        position: Positions (K, 2) [m].
        cov: Covariances (K, 2, 2) [m^2].
    """

    landmark: Int
    member: Int
    weight: Float
    position: Float
    cov: Float

    def only(self, kept: NDArray[np.bool_] | slice) -> MapRows:
        """Return the rows of a mask (K,) or a slice."""
        return MapRows(self.landmark[kept], self.member[kept], self.weight[kept], self.position[kept], self.cov[kept])

    def heaviest(self) -> NDArray[np.bool_]:
        """Return a mask (K,) of the most likely member of each ray; rays with equal weights have none."""
        same = (self.landmark[:, None] == self.landmark) & (self.member >= 0)
        rivals = np.sum(same & (self.weight[:, None] <= self.weight + EQUAL), axis=1)
        return (self.member >= 0) & (rivals == 1)


def map_at(estimate: Estimate, step: int) -> MapRows:
    """Return the last map that the history recorded up to a step; empty before the first one.

    Rays that were lost since that record, according to the log of rays, are removed.
    """
    history, log = estimate.history, estimate.rays
    assert history is not None
    end = int(np.searchsorted(history.step, step, side="right"))
    recorded = int(history.step[end - 1]) if end else step
    everything = MapRows(history.landmark, history.member, history.weight, history.position, history.cov)
    rows = everything.only(slice(int(np.searchsorted(history.step, recorded)), end))
    if log is None:
        return rows
    lost = (log.birth <= recorded) & (recorded < log.end) & (log.end <= step) & (log.survivor < 0)
    return rows.only((rows.member < 0) | ~np.isin(rows.landmark, log.landmark[lost]))
