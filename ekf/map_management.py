"""Which tracks are landmarks: probation of new ones, deletion of those that fail, merging of duplicates."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.ekf.filter import SlamFilter
from slamgauge.ekf.kernels.map_edits import NOTHING
from slamgauge.ekf.settings.association import MapManagement

GONE = -1


class Tracks:
    """The tracks of a map, in the order of its slots; without `management` all are landmarks at once."""

    def __init__(self, management: MapManagement | None) -> None:
        self._management = management
        self.ids: Int = np.zeros(0, dtype=np.int64)  # of each slot
        self._sights: Int = self.ids
        self._birth: Int = self.ids  # scan
        self._apart = np.zeros((0, 0), dtype=bool)  # pairs that one scan has seen as two
        self._scan = 0
        self._fate: Int = self.ids  # of each id ever given: itself, the id that it was merged into, or GONE

    @property
    def confirmed(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(L,) whether the track in each slot is a landmark."""
        return self._sights >= (1 if self._management is None else self._management.sights)

    @property
    def next_id(self) -> int:
        """Id of the track that will begin next."""
        return len(self._fate)

    def begin(self, count: int) -> Int:
        """Ids of `count` new tracks, in the slots after the last."""
        born = np.arange(len(self._fate), len(self._fate) + count)
        self.ids = np.concatenate([self.ids, born])
        self._fate = np.concatenate([self._fate, born])
        self._sights = np.concatenate([self._sights, np.zeros(count, dtype=np.int64)])
        self._birth = np.concatenate([self._birth, np.full(count, self._scan)])
        if self._management is not None:
            self._apart = np.pad(self._apart, (0, count))
        return born

    def close_scan(self, slam: SlamFilter, associated: Int) -> None:
        """Note the sights of a scan; then delete and merge in the filter what the rules say."""
        slots = np.flatnonzero(np.isin(self.ids, associated))
        self._sights[slots] += 1
        self._scan += 1
        if self._management is None:
            return
        self._apart[np.ix_(slots, slots)] = True
        overdue = (self._scan - self._birth >= self._management.probation) & ~self.confirmed
        for slot in np.flatnonzero(overdue)[::-1].tolist():  # from the end: removal moves the last
            slam.remove(slot)
            self._end(slot, GONE)
        self._merge(slam, associated)

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: the survivor's id, GONE if deleted or not confirmed."""
        fate = np.append(self._fate, GONE)  # fate[GONE] is GONE
        fate[self.ids[~self.confirmed]] = GONE
        while ((further := fate[ids]) != ids).any():
            ids = further
        return ids

    def _merge(self, slam: SlamFilter, associated: Int) -> None:
        """Merge what the scan's landmarks duplicate; the older id survives."""
        management = self._management
        assert management is not None
        while True:
            seen = np.flatnonzero(np.isin(self.ids, associated) & self.confirmed)
            # tracks on probation are left out by declaring them apart from all
            apart = self._apart | ~self.confirmed
            pair = slam.find_duplicate(seen, apart, management.merge_gate, management.merge_distance)
            if pair == NOTHING:
                return
            kept, gone = sorted(pair, key=lambda slot: self.ids[slot])
            slam.merge(kept, gone)
            self._sights[kept] += self._sights[gone]
            self._apart[kept] |= self._apart[gone]
            self._apart[:, kept] |= self._apart[:, gone]
            survivor = self.ids[kept]
            self._end(gone, survivor)

    def _end(self, slot: int, fate: int) -> None:
        """The track in `slot` ends; the last one takes its slot, as in `SlamFilter.remove`."""
        self._fate[self.ids[slot]] = fate
        for array in (self.ids, self._sights, self._birth):
            array[slot] = array[-1]
        self.ids, self._sights, self._birth = self.ids[:-1], self._sights[:-1], self._birth[:-1]
        if self._management is not None:
            self._apart[slot] = self._apart[-1]
            self._apart[:, slot] = self._apart[:, -1]
            self._apart = self._apart[:-1, :-1]
