"""Association of bearings without ids with landmarks, which are points or rays of members.

The distance of a bearing from a ray is that from the nearest member. `nearest-neighbour` takes the pairs of a scan in
the order of distance, if bearing and landmark are both free. `jcbb` finds the jointly compatible pairs
(`kernels.joint_compatibility`); a ray takes part with the member nearest to the bearing.

With map management, a ray is deleted if it has too few observations at first, or no recent ones: otherwise it would
attract bearings of other landmarks in its direction. `jcbb` ignores ambiguous bearings. A bearing of a point that was
not observed recently, and whose direction is uncertain, starts a ray. If this ray becomes a point, both are merged,
jointly for a scan (`maps.duplicate_landmarks`). Unlike observations with ranges, a bearing that may be an outlier of a
landmark does start a ray: many landmarks lie in one direction, most of them out of reach, and would prevent new rays.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.individual_compatibility import NONE, Pairs, keep_pairs
from slamgauge.ekf.kernels.joint_compatibility import Limits
from slamgauge.ekf.kernels.warm_up import compile_map_edits
from slamgauge.ekf.maps.duplicate_landmarks import find_matchings
from slamgauge.ekf.maps.landmark_ids import GONE, Ids, followed
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import find_duplicates
from slamgauge.ekf.maps.matching import Matcher
from slamgauge.ekf.maps.scan_clock import ScanClock
from slamgauge.ekf.settings import Association


class RayAssociation:
    """Associates bearings with landmarks; ids are 0, 1, 2, ... in the order of birth, and never used again.

    Args:
        landmarks: the map.
        settings: method, gate and map management.
    """

    def __init__(self, landmarks: LandmarkMap, settings: Association) -> None:
        self._map = landmarks
        self._matcher = Matcher(landmarks)
        if settings.map_management is not None:
            compile_map_edits(landmarks.correction.rule.retract)
        self._settings = settings
        self._ids = Ids()
        self.clock = ScanClock()
        # one entry for each id ever given:
        self._born: Int = np.zeros(0, dtype=np.int64)  # scan
        self._last: Int = np.zeros((0, 2), dtype=np.int64)  # scan and step of the last observation
        self._sights: Int = self._born
        self._fate: Int = self._born  # itself, the older landmark that it was merged into, or GONE
        self._apart: dict[int, set[int]] = {}  # landmarks observed in one scan, including the landmark itself
        self._seen: Int = self._born  # landmarks of the last scan

    @property
    def confirmed(self) -> Marks:
        """(n,) whether each id ever given is of a landmark with enough observations."""
        management = self._settings.map_management
        return (self._fate == np.arange(len(self._fate))) & (
            self._sights >= (1 if management is None else management.sights)
        )

    def associate(self, owners: Int, values: Float, covs: Float) -> Int:
        """Return the landmark of each bearing (m, 1) of a scan, known or new; -1 for ignored bearings.

        Args:
            owners: (L,) landmark of each slot.
            values: (m, 1) [rad].
            covs: (m, 1, 1) [rad^2].
        """
        pairs, noise_covs = self._matcher.compatible(values, covs, self._settings.gate)
        pairs = _keep_nearest_members(pairs, owners)
        doubtful = np.zeros(len(values), dtype=bool)
        if self._settings.method == "jcbb":
            found, doubtful = self._jointly(pairs, noise_covs, owners)
        else:
            found = self._nearest(pairs, len(values))
        new = (found == NONE) & ~doubtful
        found[new] = self._ids.take(int(new.sum()))
        self._note(found[new], found[found != NONE])
        return found

    def _note(self, begun: Int, seen: Int) -> None:
        """Store the landmarks of a scan; `begun` are the new ones among them."""
        self._born = np.append(self._born, np.full(len(begun), self.clock.scan))
        self._fate = np.append(self._fate, begun)
        self._sights = np.append(self._sights, np.zeros_like(begun))
        self._last = np.append(self._last, np.zeros((len(begun), 2), dtype=np.int64), axis=0)
        self._sights[seen] += 1
        self._last[seen] = self.clock.now
        if self._settings.map_management is not None:
            for landmark in seen.tolist():
                self._apart.setdefault(landmark, set()).update(seen.tolist())
        self._seen = seen
        self.clock.close_scan()

    def given_up(self, rays: Int, points: Int) -> Int:
        """Give up landmarks with too few observations at first, and rays without recent ones; return both."""
        management = self._settings.map_management
        if management is None:
            return rays[:0]
        landmarks = np.concatenate([rays, points])
        proven = self.confirmed[landmarks] | (self._born[landmarks] > self.clock.scan - management.probation)
        recent = self.clock.are_recent(self._last[rays], management.probation)
        gone = np.union1d(landmarks[~proven], rays[~recent])
        self._end(gone, GONE)
        for each in gone.tolist():
            self._part(each)
        return gone

    def agreed(self, owners: Int, points: Int) -> Int:
        """Return pairs (p, 2) of duplicate landmarks, the older first; one is a point of the last scan.

        Args:
            owners: (L,) landmark of each slot.
            points: landmarks that are points.
        """
        management, is_seen = self._settings.map_management, np.isin(points, self._seen)
        if management is None or not is_seen.any():
            return np.zeros((0, 2), dtype=np.int64)
        slots = np.flatnonzero(np.isin(owners, points[is_seen]))
        is_other = np.isin(owners, points[~is_seen & self.confirmed[points]])
        apart = np.stack([~is_other | np.isin(owners, [*self._apart[each]]) for each in owners[slots].tolist()])
        pairs = find_duplicates(self._map, slots, apart, management.merge_gate)
        if not len(pairs):
            return pairs
        matchings = find_matchings(self._map, pairs, self._sights[owners], management.new_density)
        return np.sort(owners[matchings.agreed(management.certainty)], axis=1)

    def join(self, kept: int, gone: int) -> None:
        """Merge two landmarks."""
        self._sights, self._last = self._sights.copy(), self._last.copy()
        self._sights[kept] += self._sights[gone]
        self._last[kept] = np.maximum(self._last[kept], self._last[gone])
        self._end(gone, kept)
        for each in self._part(gone):
            self._apart[kept].add(each)
            self._apart[each].add(kept)
        self._seen = np.where(self._seen == gone, kept, self._seen)

    def survivors(self, ids: Int) -> Int:
        """Return the present ids of ids (n,): that of the merged landmark, or -1 if deleted."""
        return followed(np.append(self._fate, GONE))[ids]

    def _end(self, landmarks: int | Int, fate: int) -> None:
        self._fate = self._fate.copy()
        self._fate[landmarks] = fate

    def _part(self, gone: int) -> set[int]:
        """Remove `gone` from `_apart`; return the landmarks that one scan observed together with it."""
        others = self._apart.pop(gone) - {gone}
        for each in others:
            self._apart[each].discard(gone)
        return others

    def _nearest(self, pairs: Pairs, observations: int) -> Int:
        found = np.full(observations, NONE)
        for c in np.argsort(pairs.distance, kind="stable"):
            if pairs.distance[c] > self._settings.gate:
                break
            if found[pairs.observation[c]] == NONE and pairs.owner[c] not in found:
                found[pairs.observation[c]] = pairs.owner[c]
        return found

    def _jointly(self, pairs: Pairs, covs: Float, owners: Int) -> tuple[Int, Marks]:
        """Return the landmarks (m,) of bearings with covariances (m, 2, 2), and whether each bearing is ambiguous."""
        gate, observations = self._settings.gate, len(covs)
        rarer = chdtrc(1.0, gate)  # probability of a larger distance, 1 degree of freedom
        quantiles = np.concatenate([[0.0], chdtri(np.arange(1.0, observations + 1), rarer)])
        management = self._settings.map_management
        if management is not None:
            recent = self.clock.are_recent(self._last[owners], management.probation)
            pairs = self._matcher.located(pairs, covs, management.vagueness, recent)
        slots = self._matcher.jointly_compatible(pairs, covs, gate, quantiles, self._settings.node_limit)
        doubtful = np.zeros(observations, dtype=bool)
        if management is not None:
            limits = Limits(gate, management.margin, self._settings.node_limit)
            doubtful = self._matcher.ambiguous(pairs, covs, slots, limits)
            slots[doubtful] = NONE
        return np.append(owners, NONE)[slots], doubtful  # index NONE is the last entry


def _keep_nearest_members(pairs: Pairs, owners: Int) -> Pairs:
    """Set the owners of the pairs; return the nearest pair of each bearing and owner."""
    observation, owner, distance = pairs.observation, owners[pairs.slot], pairs.distance
    order = np.lexsort((distance, owner, observation))
    leads = np.diff(observation[order], prepend=NONE) != 0
    leads |= np.diff(owner[order], prepend=NONE) != 0
    kept = order[leads]
    pairs.owner[:] = owner
    return keep_pairs(pairs, kept)
