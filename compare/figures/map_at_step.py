"""The map of an estimate as it stood at a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate

EQUAL = 1e-9  # weights that differ by less


class MapRows(NamedTuple):
    """Rows of a `MapHistory`, of one step: a point each, or a member of a ray.

    Attributes:
        landmark: (K,) id.
        member: (K,) its number along the ray, -1 for a point.
        weight: (K,) probability of the member, 1 for a point.
        position: (K, 2) [m].
        cov: (K, 2, 2) [m^2].
    """

    landmark: Int
    member: Int
    weight: Float
    position: Float
    cov: Float

    def only(self, kept: NDArray[np.bool_] | slice) -> MapRows:
        """The rows `kept`, by a mask (K,) or from one to another."""
        return MapRows(self.landmark[kept], self.member[kept], self.weight[kept], self.position[kept], self.cov[kept])

    def heaviest(self) -> NDArray[np.bool_]:
        """Which rows (K,) are the heaviest members of their rays; none of a ray whose members weigh the same."""
        same = (self.landmark[:, None] == self.landmark) & (self.member >= 0)
        rivals = np.sum(same & (self.weight[:, None] <= self.weight + EQUAL), axis=1)
        return (self.member >= 0) & (rivals == 1)


def map_at(estimate: Estimate, step: int) -> MapRows:
    """The map that the estimate's history has last noted up to a step; nothing before that.

    A ray that was lost between the two, as the log of rays tells, is left out.
    """
    history, log = estimate.history, estimate.rays
    assert history is not None
    end = int(np.searchsorted(history.step, step, side="right"))
    noted = int(history.step[end - 1]) if end else step
    everything = MapRows(history.landmark, history.member, history.weight, history.position, history.cov)
    rows = everything.only(slice(int(np.searchsorted(history.step, noted)), end))
    if log is None:
        return rows
    lost = (log.birth <= noted) & (noted < log.end) & (log.end <= step) & (log.survivor < 0)
    return rows.only((rows.member < 0) | ~np.isin(rows.landmark, log.landmark[lost]))
