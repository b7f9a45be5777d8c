"""The ids that a filter gives to the observations of a recording."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.recording import Recording


class GivenIds:
    """Notes them scan by scan; as long as they are the recording's own, that has them, and no room is taken."""

    def __init__(self, recording: Recording) -> None:
        own = recording.landmark
        self._are_own = own is not None
        self._ids = np.empty(len(recording.observation), np.int64) if own is None else own
        self._seen = 0

    def note(self, ids: Int) -> None:
        """Ids (m,) of the next observations."""
        rows = slice(self._seen, self._seen + len(ids))
        self._seen = rows.stop
        if self._are_own and not (ids == self._ids[rows]).all():
            self._ids, self._are_own = self._ids.copy(), False
        if not self._are_own:
            self._ids[rows] = ids

    def all(self) -> Int:
        """Those of all observations (M,)."""
        return self._ids
