"""Which landmark a bearing is of, landmarks being points or rays of members: one bearing claims one landmark.

A bearing is as far from a ray as from the nearest of its members. `nearest-neighbour` then goes through the pairs of a
scan, the nearest first, and takes those of which both are free; `jcbb` finds the pairs that are jointly compatible
(`kernels.joint_search`), each ray standing for its member that is nearest to the bearing.

With map management a ray must be seen often enough at first, or it was none, and one that is not seen for long is given
up: it lies in the direction of whatever comes there next. `jcbb` leaves out bearings that are ambiguous, and those of a
point that was not seen lately and whose direction is not known: they begin a ray, and where that becomes a point, the
two are joined, all of a scan jointly (`maps.joining`). One rule for ranges does not hold here: a bearing that may be an
outlier of a landmark begins a ray all the same (many landmarks lie in a direction, most of them out of reach, and would
keep new ones from beginning).
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.compatibility import NONE, Pairs, keep_pairs
from slamgauge.ekf.maps.ids import Ids
from slamgauge.ekf.maps.joining import find_matchings
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.matching import Matcher
from slamgauge.ekf.maps.tracks import ScanClock
from slamgauge.ekf.settings.association import Association, MapManagement


class RayAssociation:
    """Gives landmarks their ids: 0, 1, 2, ... in the order of birth, none ever used again.

    Args:
        landmarks: the map.
        settings: how bearings are associated.
    """

    def __init__(self, landmarks: LandmarkMap, settings: Association) -> None:
        self._map = landmarks
        self._matcher = Matcher(landmarks)
        self._settings = settings
        self._ids = Ids()
        self.clock = ScanClock()
        self._born: list[int] = []  # scan in which each landmark began
        self._last: list[tuple[int, int]] = []  # scan and step that saw it last
        self._sights: list[int] = []
        self._gone: set[int] = set()
        self._survivors: dict[int, int] = {}  # of landmarks that were joined with an older one
        self._apart: dict[int, set[int]] = {}  # landmarks that one scan has seen as two, themselves included
        self._seen: list[int] = []  # landmarks of the last scan

    def associate(self, owners: Int, values: Float, covs: Float) -> Int:
        """Landmark of each bearing (m, 1) of a scan, new ones included; -1 for bearings that are left out.

        Args:
            owners: (L,) landmark of each slot.
            values: (m, 1) [rad].
            covs: (m, 1, 1) [rad^2].
        """
        pairs, count = self._matcher.compatible(values, covs, self._settings.gate)
        count = _keep_nearest_members(pairs, count, owners)
        doubtful = np.zeros(len(values), dtype=bool)
        if self._settings.method == "jcbb":
            found, doubtful = self._jointly(count, len(values), owners)
        else:
            found = self._nearest(pairs, count, len(values))
        new = (found == NONE) & ~doubtful
        found[new] = self._ids.take(int(new.sum()))
        begun = int(new.sum())
        self._born += [self.clock.scan] * begun
        self._last += [self.clock.now] * begun
        self._sights += [0] * begun
        self._seen = found[found != NONE].tolist()
        for landmark in self._seen:
            self._sights[landmark] += 1
            self._last[landmark] = self.clock.now
            if self._settings.map_management is not None:
                self._apart.setdefault(landmark, set()).update(self._seen)
        self.clock.close_scan()
        return found

    def given_up(self, rays: set[int], points: set[int]) -> list[int]:
        """Landmarks that were seen too seldom at first, and rays not seen for long; they are gone for good."""
        management = self._settings.map_management
        if management is None:
            return []
        old = self.clock.scan - management.probation
        gone = {each for each in rays | points if self._born[each] <= old and not self.is_confirmed(each)}
        gone.update(each for each in rays if not self._is_recent(each, management))
        self._gone |= gone
        for each in gone:
            self._part(each)
        return sorted(gone)

    def agreed(self, owners: Int, points: set[int]) -> list[tuple[int, int]]:
        """Pairs of landmarks that certainly are one, the older first: of the last scan's `points`, and of others.

        Args:
            owners: (L,) landmark of each slot.
            points: landmarks that are points.
        """
        management, seen = self._settings.map_management, points.intersection(self._seen)
        if management is None or not seen:
            return []
        slots = np.flatnonzero(np.isin(owners, [*seen]))
        landmarks = [each for each in points - seen if self.is_confirmed(each)]
        apart = np.tile(~np.isin(owners, landmarks), (len(owners), 1))
        for slot in slots.tolist():
            apart[slot] |= np.isin(owners, [*self._apart[int(owners[slot])]])
        pairs = self._map.find_duplicates(slots, apart, management.merge_gate)
        if not len(pairs):
            return []
        sights = np.array(self._sights, dtype=np.int64)[owners]
        matchings = find_matchings(self._map, pairs, sights, management.new_density)
        if matchings is None:
            return []
        return [(min(each), max(each)) for each in owners[matchings.agreed(management.certainty)].tolist()]

    def join(self, kept: int, gone: int) -> None:
        """Take two landmarks for one."""
        self._sights[kept] += self._sights[gone]
        self._last[kept] = max(self._last[kept], self._last[gone])
        for each in self._part(gone):
            self._apart[kept].add(each)
            self._apart[each].add(kept)
        self._seen = [kept if each == gone else each for each in self._seen]
        self._survivors[gone] = kept

    def survivors(self, ids: Int) -> Int:
        """What landmarks (n,) have become by being joined with others."""
        return np.array([self._survivor(each) for each in ids.tolist()], dtype=np.int64)

    def _survivor(self, landmark: int) -> int:
        while landmark in self._survivors:
            landmark = self._survivors[landmark]
        return landmark

    def _part(self, gone: int) -> set[int]:
        """The landmarks that were seen as others than `gone`, about which nothing is noted any more."""
        others = self._apart.pop(gone) - {gone}
        for each in others:
            self._apart[each].discard(gone)
        return others

    def _is_recent(self, landmark: int, management: MapManagement) -> bool:
        """Whether a landmark was seen as lately as probation takes."""
        return bool(self.clock.are_recent(np.array([self._last[landmark]]), management.probation)[0])

    def is_confirmed(self, landmark: int) -> bool:
        """Whether a landmark has been seen often enough."""
        management = self._settings.map_management
        return landmark not in self._gone and self._sights[landmark] >= (1 if management is None else management.sights)

    def _nearest(self, pairs: Pairs, count: int, observations: int) -> Int:
        found = np.full(observations, NONE)
        for c in np.argsort(pairs.distance[:count], kind="stable"):
            if pairs.distance[c] > self._settings.gate:
                break
            if found[pairs.observation[c]] == NONE and pairs.owner[c] not in found:
                found[pairs.observation[c]] = pairs.owner[c]
        return found

    def _jointly(self, count: int, observations: int, owners: Int) -> tuple[Int, Marks]:
        """Landmarks, and which bearings have none because they are ambiguous."""
        gate = self._settings.gate
        rarer = chdtrc(1.0, gate)  # probability beyond the gate, 1 degree of freedom
        quantiles = np.concatenate([[0.0], chdtri(np.arange(1.0, observations + 1), rarer)])
        management = self._settings.map_management
        if management is not None:
            recent = self.clock.are_recent(
                np.array(self._last, dtype=np.int64).reshape(-1, 2)[owners], management.probation
            )
            count = self._matcher.located(count, management.vagueness, recent)
        slots = self._matcher.jointly_compatible(count, gate, quantiles, self._settings.node_limit)
        doubtful = np.zeros(observations, dtype=bool)
        if management is not None:
            margin, limit = management.margin, self._settings.node_limit
            doubtful = self._matcher.ambiguous(count, gate, margin, limit, slots)
            slots[doubtful] = NONE
        return np.append(owners, NONE)[slots], doubtful  # NONE is the last


def _keep_nearest_members(pairs: Pairs, count: int, owners: Int) -> int:
    """Note the owners of the first `count` pairs, and keep the nearest pair of each bearing and owner."""
    observation, owner, distance = pairs.observation[:count], owners[pairs.slot[:count]], pairs.distance[:count]
    order = np.lexsort((distance, owner, observation))
    leads = np.diff(observation[order], prepend=NONE) != 0
    leads |= np.diff(owner[order], prepend=NONE) != 0
    kept = order[leads]
    pairs.owner[:count] = owners[pairs.slot[:count]]
    return keep_pairs(pairs, kept)
