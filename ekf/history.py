"""What a filter gives at each step of a run: ids of observations, and the map at some steps."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.ekf.maps.input_checks import without_rounding
from slamgauge.ekf.online_filter import Members, OnlineFilter, joined
from slamgauge.estimate import MapHistory
from slamgauge.recording import Recording


class Associations:
    """Ids (M,) that a filter gives to the observations; the recording's own array while both are equal."""

    def __init__(self, recording: Recording) -> None:
        own = recording.landmark
        self.ids = np.empty(len(recording.observation), np.int64) if own is None else own
        self._are_own, self._count = own is not None, 0

    def append(self, ids: Int) -> None:
        """Add the ids (m,) of the next observations."""
        rows = slice(self._count, self._count + len(ids))
        self._count = rows.stop
        if self._are_own and not (ids == self.ids[rows]).all():
            self.ids, self._are_own = self.ids.copy(), False
        if not self._are_own:
            self.ids[rows] = ids


class History:
    """The map at `frames` of the steps 0..`steps`, evenly spread, with the first and the last."""

    def __init__(self, steps: int, frames: int) -> None:
        self._wanted = {*np.linspace(0, steps, min(frames, steps + 1)).round().astype(int).tolist()}
        self._steps: list[int] = []
        self._maps: list[Members] = []

    def keep(self, step: int, slam: OnlineFilter) -> None:
        """Store the map after this step, if it is one of these steps."""
        if step in self._wanted:
            self._steps.append(step)
            self._maps.append(slam.whole_map())

    def kept(self) -> MapHistory | None:
        """Return the stored maps; None without frames."""
        if not self._maps:
            return None
        rows = joined(self._maps)
        step = np.repeat(np.array(self._steps), [len(each.landmark) for each in self._maps])
        cov = without_rounding("history.cov", rows.cov)
        return MapHistory(step, rows.landmark, rows.number, np.minimum(rows.weight, 1.0), rows.position, cov)
