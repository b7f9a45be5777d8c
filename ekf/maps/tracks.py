"""Tracks, the candidates of landmarks without ids: probation, deletion, merging of duplicates.

The id of a track is its number, 0, 1, 2, ... in the order of birth. A robot that returns with an uncertain position
cannot associate a scan with its old landmarks; the observations start tracks. A track and an old landmark that no scan
has observed together are merged if their difference is compatible with zero and neither has another such partner.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.kernels.individual_compatibility import find_duplicates
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.settings import MapManagement


class Tracks:
    """The tracks of a map, in the order of its slots; without `management` every track is a landmark.

    Args:
        landmarks: the map.
        management: probation and merging; None for none.
    """

    def __init__(self, landmarks: LandmarkMap, management: MapManagement | None) -> None:
        self._map = landmarks
        self._management = management
        self._scan = 0
        self._sights: Int = np.zeros(0, dtype=np.int64)  # observations of each slot
        self._birth: Int = self._sights  # scan
        self._apart = np.zeros((0, 0), dtype=bool)  # pairs that one scan has observed together
        self._fate: Int = self._sights  # for each id ever given: itself, the id that it was merged into, or NONE

    @property
    def confirmed(self) -> Marks:
        """(L,) whether the track in each slot is a landmark."""
        return self._sights >= (1 if self._management is None else self._management.sights)

    def close_scan(self, associated: Int) -> None:
        """Store the tracks of a scan, known and new; then delete failed tracks and merge duplicates."""
        self._begin()
        slots = np.flatnonzero(np.isin(self._map.ids, associated))
        self._sights[slots] += 1
        self._scan += 1
        if self._management is None:
            return
        self._apart[np.ix_(slots, slots)] = True
        overdue = (self._scan - self._birth >= self._management.probation) & ~self.confirmed
        for slot in np.flatnonzero(overdue)[::-1].tolist():  # from the end: removal moves the last slot
            self._end(slot, NONE)
        self._join(associated, self._management.merge_gate)

    def _begin(self) -> None:
        """Store the tracks that were added to the map since the last scan."""
        born = np.arange(len(self._fate), self._map.ids_taken)
        self._fate = np.concatenate([self._fate, born])
        self._sights = np.concatenate([self._sights, np.zeros(len(born), dtype=np.int64)])
        self._birth = np.concatenate([self._birth, np.full(len(born), self._scan)])
        if self._management is not None:
            self._apart = np.pad(self._apart, (0, len(born)))

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids: that of the merged track, or NONE if deleted or unconfirmed."""
        fate = np.append(self._fate, NONE)  # fate[NONE] is NONE
        fate[self._map.ids[~self.confirmed]] = NONE
        return followed(fate)[ids]

    def _join(self, associated: Int, gate: float) -> None:
        """Merge the scan's tracks with their duplicates, one pair after the other; the older id remains."""
        while True:
            seen = np.isin(self._map.ids, followed(np.append(self._fate, NONE))[associated]) & self.confirmed
            apart = self._apart[seen] | ~self.confirmed | seen  # not with tracks on probation or of the same scan
            pairs = find_duplicates(self._map.belief, np.flatnonzero(seen), apart, gate)
            partners = np.bincount(pairs.ravel(), minlength=len(self._map.ids))
            alone = pairs[(partners[pairs] == 1).all(axis=1)]
            if not len(alone):
                return
            older_first = alone[0][np.argsort(self._map.ids[alone[0]])]
            self._merge(*older_first.tolist())

    def _merge(self, kept: int, gone: int) -> None:
        """Merge the landmarks in two slots."""
        self._sights[kept] += self._sights[gone]
        self._apart[kept] |= self._apart[gone]
        self._apart[:, kept] |= self._apart[:, gone]
        ids = self._map.ids[[kept, gone]].tolist()
        self._map.equate(*ids)
        self._end(gone, ids[0])

    def _end(self, slot: int, fate: int) -> None:
        """Remove the track in `slot`; the last one moves into its slot, as in the map."""
        name = int(self._map.ids[slot])
        self._fate[name] = fate
        self._map.remove(name)
        for array in (self._sights, self._birth):
            array[slot] = array[-1]
        self._sights, self._birth = self._sights[:-1], self._birth[:-1]
        if self._management is not None:
            self._apart[slot] = self._apart[-1]
            self._apart[:, slot] = self._apart[:, -1]
            self._apart = self._apart[:-1, :-1]


def followed(fate: Int) -> Int:
    """Return the final successor of each id from the next one, `fate`; the last entry is that of NONE."""
    while ((further := fate[fate]) != fate).any():
        fate = further
    return fate
