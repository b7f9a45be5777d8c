"""The map as a filter saw it on its way, for pictures."""

from __future__ import annotations

import numpy as np

from slamgauge.ekf.maps.input_checks import without_rounding
from slamgauge.ekf.maps.members import Members, joined
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.estimate import MapHistory


class History:
    """Keeps the map at `frames` of the steps 0..`steps`, evenly spread, the first and the last among them."""

    def __init__(self, steps: int, frames: int) -> None:
        self._wanted = {*np.linspace(0, steps, min(frames, steps + 1)).round().astype(int).tolist()}
        self._steps: list[int] = []
        self._maps: list[Members] = []

    def keep(self, step: int, slam: OnlineFilter) -> None:
        """Note the map after this step, if it is one of those."""
        if step in self._wanted:
            self._steps.append(step)
            self._maps.append(slam.whole_map())

    def kept(self) -> MapHistory | None:
        """All that was noted; None without frames."""
        if not self._maps:
            return None
        rows = joined(self._maps)
        step = np.repeat(np.array(self._steps), [len(each.landmark) for each in self._maps])
        cov = without_rounding("history.cov", rows.cov)
        return MapHistory(step, rows.landmark, rows.number, np.minimum(rows.weight, 1.0), rows.position, cov)
