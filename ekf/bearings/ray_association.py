"""Which landmark a bearing is of, landmarks being points or rays of members: one bearing claims one landmark.

A bearing is as far from a ray as from the nearest of its members. `nearest-neighbour` then goes through the pairs of a
scan, the nearest first, and takes those of which both are free; `jcbb` finds the pairs that are jointly compatible
(`kernels.joint_compatibility`), each ray standing for its member that is nearest to the bearing.

With map management a ray must be seen often enough at first, or it was none, and one that is not seen for long is given
up: it lies in the direction of whatever comes there next. `jcbb` leaves out bearings that are ambiguous, and those of a
point that was not seen lately and whose direction is not known: they begin a ray, and where that becomes a point, the
two are joined, all of a scan jointly (`maps.duplicate_landmarks`). One rule for ranges does not hold here: a bearing
that may be an outlier of a landmark begins a ray all the same (many landmarks lie in a direction, most of them out of
reach, and would keep new ones from beginning).
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
from slamgauge.ekf.settings.association import Association


class RayAssociation:
    """Gives landmarks their ids: 0, 1, 2, ... in the order of birth, none ever used again.

    Args:
        landmarks: the map.
        settings: how bearings are associated.
    """

    def __init__(self, landmarks: LandmarkMap, settings: Association) -> None:
        self._map = landmarks
        self._matcher = Matcher(landmarks)
        if settings.map_management is not None:
            compile_map_edits(landmarks.correction.rule.retract)
        self._settings = settings
        self._ids = Ids()
        self.clock = ScanClock()
        # of each id ever given
        self._born: Int = np.zeros(0, dtype=np.int64)  # scan
        self._last: Int = np.zeros((0, 2), dtype=np.int64)  # scan and step that saw it last
        self._sights: Int = self._born
        self._fate: Int = self._born  # itself, the older one that it was joined with, or GONE
        self._apart: dict[int, set[int]] = {}  # landmarks that one scan has seen as two, themselves included
        self._seen: Int = self._born  # landmarks of the last scan

    @property
    def confirmed(self) -> Marks:
        """Whether each id ever given is of a landmark that was seen often enough."""
        management = self._settings.map_management
        return (self._fate == np.arange(len(self._fate))) & (
            self._sights >= (1 if management is None else management.sights)
        )

    def associate(self, owners: Int, values: Float, covs: Float) -> Int:
        """Landmark of each bearing (m, 1) of a scan, new ones included; -1 for bearings that are left out.

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
        """Note the landmarks of a scan, those that begin with it among them."""
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
        """Landmarks that were seen too seldom at first, and rays not seen for long; they are gone for good."""
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
        """Pairs (p, 2) of landmarks that certainly are one, the older first: a point of the last scan, and another.

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
        """Take two landmarks for one."""
        self._sights, self._last = self._sights.copy(), self._last.copy()
        self._sights[kept] += self._sights[gone]
        self._last[kept] = np.maximum(self._last[kept], self._last[gone])
        self._end(gone, kept)
        for each in self._part(gone):
            self._apart[kept].add(each)
            self._apart[each].add(kept)
        self._seen = np.where(self._seen == gone, kept, self._seen)

    def survivors(self, ids: Int) -> Int:
        """What has become of ids (n,): joined ones have their survivor's, those that are gone -1."""
        return followed(np.append(self._fate, GONE))[ids]

    def _end(self, landmarks: int | Int, fate: int) -> None:
        self._fate = self._fate.copy()
        self._fate[landmarks] = fate

    def _part(self, gone: int) -> set[int]:
        """The landmarks that were seen as others than `gone`, about which nothing is noted any more."""
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
        """Return the landmarks (m,) of bearings with covariances (m, 2, 2), and which have none: they are ambiguous."""
        gate, observations = self._settings.gate, len(covs)
        rarer = chdtrc(1.0, gate)  # probability beyond the gate, 1 degree of freedom
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
        return np.append(owners, NONE)[slots], doubtful  # NONE is the last


def _keep_nearest_members(pairs: Pairs, owners: Int) -> Pairs:
    """Set the owners of the pairs, and return the nearest pair of each bearing and owner."""
    observation, owner, distance = pairs.observation, owners[pairs.slot], pairs.distance
    order = np.lexsort((distance, owner, observation))
    leads = np.diff(observation[order], prepend=NONE) != 0
    leads |= np.diff(owner[order], prepend=NONE) != 0
    kept = order[leads]
    pairs.owner[:] = owner
    return keep_pairs(pairs, kept)
