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
    """The tracks of a map; without `management` every track is a landmark.

    Args:
        landmarks: the map.
        management: probation and merging; None for none.
    """

    def __init__(self, landmarks: LandmarkMap, management: MapManagement | None) -> None:
        self._map, self._management = landmarks, management
        self._scan = 0
        self._sights = dict[int, int]()  # observations of each track in the map
        self._birth = dict[int, int]()  # its first scan
        self._met = dict[int, set[int]]()  # tracks that one scan has observed together with it
        self._fate = dict[int, int]()  # id that each ended track was merged into, or NONE

    @property
    def confirmed(self) -> Marks:
        """(L,) whether the track in each slot is a landmark."""
        least = 1 if self._management is None else self._management.sights
        return np.array([self._sights[each] >= least for each in self._map.ids.tolist()], dtype=np.bool_)

    def close_scan(self, associated: Int) -> None:
        """Store the tracks of a scan, known and new; then delete failed tracks and merge duplicates."""
        seen = {*associated.tolist()} - {NONE}
        for each in seen:
            self._sights[each] = self._sights.get(each, 0) + 1
            self._birth.setdefault(each, self._scan)
        self._scan += 1
        if self._management is None:
            return
        for each in seen:
            self._met.setdefault(each, set()).update(seen)
        for each in self._map.ids[~self.confirmed].tolist():
            if self._scan - self._birth[each] >= self._management.probation:
                self._end(each, NONE)
        self._join(seen, self._management.merge_gate)

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids: that of the merged track, or NONE if deleted or unconfirmed."""
        fate = np.append(np.arange(self._map.ids_taken), NONE)  # fate[NONE] is NONE
        for name, successor in self._fate.items():
            fate[name] = successor
        fate[self._map.ids[~self.confirmed]] = NONE
        return followed(fate)[ids]

    def _join(self, seen: set[int], gate: float) -> None:
        """Merge the scan's tracks with their duplicates, one pair after the other; the older id remains."""
        while True:
            seen = {self._fate.get(each, each) for each in seen}
            ids, confirmed = self._map.ids, self.confirmed
            slots = np.flatnonzero(np.isin(ids, [*seen]) & confirmed)
            apart = np.tile(~confirmed, (len(slots), 1))  # not with tracks on probation, of the same or an earlier scan
            for row, each in enumerate(ids[slots].tolist()):
                apart[row] |= [other in self._met[each] or other in seen for other in ids.tolist()]
            pairs = find_duplicates(self._map.belief, slots, apart, gate)
            partners = np.bincount(pairs.ravel(), minlength=len(ids))
            alone = pairs[(partners[pairs] == 1).all(axis=1)]
            if not len(alone):
                return
            self._merge(*sorted(ids[alone[0]].tolist()))

    def _merge(self, kept: int, gone: int) -> None:
        self._sights[kept] += self._sights[gone]
        self._met[kept] |= self._met[gone]
        for met in self._met.values():
            if gone in met:
                met.add(kept)
        self._map.equate(kept, gone)
        self._end(gone, kept)

    def _end(self, name: int, fate: int) -> None:
        """Remove a track from the map."""
        self._fate[name] = fate
        self._map.remove(name)
        for table in (self._sights, self._birth, self._met):
            table.pop(name, None)


def followed(fate: Int) -> Int:
    """Return the final successor of each id from the next one, `fate`; the last entry is that of NONE."""
    while ((further := fate[fate]) != fate).any():
        fate = further
    return fate
