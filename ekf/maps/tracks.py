"""Which tracks are landmarks: probation of new ones, deletion of those that fail, joining of duplicates.

A track is what observations without ids are associated with. Its id is its number, 0, 1, 2, ... in the order of birth.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.ekf.maps.duplicate_landmarks import Matchings, find_matchings
from slamgauge.ekf.maps.landmark_ids import GONE, Ids, followed
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import find_duplicates, merge_landmarks, remove_landmark
from slamgauge.ekf.maps.scan_clock import ScanClock
from slamgauge.ekf.settings import MapManagement


class Tracks:
    """The tracks of a map, in the order of its slots; without `management` all are landmarks at once.

    Args:
        landmarks: the map.
        management: the rules.

    Attributes:
        clock: of the scans.
        matchings: what the tracks of the last scan may be of the map's landmarks; None if they are none of them.
    """

    def __init__(self, landmarks: LandmarkMap, management: MapManagement | None) -> None:
        self._map = landmarks
        self._management = management
        self.new_ids = Ids()
        self.matchings: Matchings | None = None
        self._sights: Int = np.zeros(0, dtype=np.int64)  # of each slot
        self._birth: Int = self._sights  # scan
        self._last: Int = np.zeros((0, 2), dtype=np.int64)  # scan and step that saw it last
        self._apart = np.zeros((0, 0), dtype=bool)  # pairs that one scan has seen as two
        self.clock = ScanClock()
        self._fate: Int = self._sights  # of each id ever given: itself, the id that it was merged into, or GONE

    @property
    def ids(self) -> Int:
        """(L,) of the track in each slot."""
        return self._map.state.ids

    @property
    def confirmed(self) -> Marks:
        """(L,) whether the track in each slot is a landmark."""
        return self._sights >= (1 if self._management is None else self._management.sights)

    @property
    def recent(self) -> Marks:
        """(L,) whether the track in each slot was seen as lately as probation takes."""
        assert self._management is not None
        return self.clock.are_recent(self._last, self._management.probation)

    def close_scan(self, associated: Int) -> None:
        """Note the tracks of a scan, the new ones among them; then delete and join in the map what the rules say."""
        self._begin()
        slots = np.flatnonzero(np.isin(self.ids, associated))
        self._sights[slots] += 1
        self._last[slots] = self.clock.now
        self.clock.close_scan()
        if self._management is None:
            return
        self._apart[np.ix_(slots, slots)] = True
        overdue = (self.clock.scan - self._birth >= self._management.probation) & ~self.confirmed
        for slot in np.flatnonzero(overdue)[::-1].tolist():  # from the end: removal moves the last
            self._end(slot, GONE)
            remove_landmark(self._map, slot)
        self._join(associated, self._management)

    def _begin(self) -> None:
        """Note the tracks that the map has been given since the last scan."""
        born = np.arange(len(self._fate), self.new_ids.given)
        self._fate = np.concatenate([self._fate, born])
        self._sights = np.concatenate([self._sights, np.zeros(len(born), dtype=np.int64)])
        self._birth = np.concatenate([self._birth, np.full(len(born), self.clock.scan)])
        self._last = np.concatenate([self._last, np.full((len(born), 2), self.clock.now)])
        if self._management is not None:
            self._apart = np.pad(self._apart, (0, len(born)))

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: the survivor's id, GONE if deleted or not confirmed."""
        fate = np.append(self._fate, GONE)  # fate[GONE] is GONE
        fate[self.ids[~self.confirmed]] = GONE
        return followed(fate)[ids]

    def _join(self, associated: Int, management: MapManagement) -> None:
        """Join the landmarks that the scan has seen with those that they certainly are; the older id survives."""
        while True:
            seen = np.isin(self.ids, followed(np.append(self._fate, GONE))[associated])
            # tracks on probation are no landmarks to join with, nor are two of the scan one
            apart = self._apart[seen] | ~self.confirmed | seen
            pairs = find_duplicates(self._map, np.flatnonzero(seen), apart, management.merge_gate)
            if not len(pairs):
                self.matchings = None
                return
            self.matchings = find_matchings(self._map, pairs, self._sights, management.new_density)
            agreed = self.matchings.agreed(management.certainty)
            if not len(agreed):
                return
            for names in self.ids[agreed].tolist():
                self._merge(*(int(np.flatnonzero(self.ids == name)[0]) for name in sorted(names)))

    def _merge(self, kept: int, gone: int) -> None:
        """Take two slots for one landmark."""
        self._sights[kept] += self._sights[gone]
        self._last[kept] = np.maximum(self._last[kept], self._last[gone])
        self._apart[kept] |= self._apart[gone]
        self._apart[:, kept] |= self._apart[:, gone]
        self._end(gone, int(self.ids[kept]))
        merge_landmarks(self._map, kept, gone)

    def _end(self, slot: int, fate: int) -> None:
        """The track in `slot` ends; the last one takes its slot, as in `map_edits.remove_landmark`."""
        self._fate[self.ids[slot]] = fate
        for array in (self._sights, self._birth, self._last):
            array[slot] = array[-1]
        self._sights, self._birth, self._last = self._sights[:-1], self._birth[:-1], self._last[:-1]
        if self._management is not None:
            self._apart[slot] = self._apart[-1]
            self._apart[:, slot] = self._apart[:, -1]
            self._apart = self._apart[:-1, :-1]
