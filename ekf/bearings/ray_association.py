"""Which landmark a bearing is of, landmarks being points or rays of members: one bearing claims one landmark.

A bearing is as far from a ray as from the nearest of its members. `nearest-neighbour` then goes through the pairs of a
scan, the nearest first, and takes those of which both are free; `jcbb` finds the pairs that are jointly compatible
(`kernels.joint_search`), each ray standing for its member that is nearest to the bearing.

With map management a ray must be seen often enough at first, or it was none, and `jcbb` leaves out bearings that are
ambiguous. Two of its rules for ranges do not hold here: a bearing that may be an outlier of a landmark begins a ray all
the same (many landmarks lie in a direction, most of them out of reach, and would keep new ones from beginning), and
points are not merged.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.compatibility import NONE, Pairs, keep_pairs
from slamgauge.ekf.maps.ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.matching import Matcher
from slamgauge.ekf.settings.association import Association


class RayAssociation:
    """Gives landmarks their ids: 0, 1, 2, ... in the order of birth, none ever used again.

    Args:
        landmarks: the map.
        settings: how bearings are associated.
    """

    def __init__(self, landmarks: LandmarkMap, settings: Association) -> None:
        self._matcher = Matcher(landmarks)
        self._settings = settings
        self._ids = Ids()
        self._born: list[int] = []  # scan in which each landmark began
        self._sights: list[int] = []
        self._gone: set[int] = set()
        self._scan = 0

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
        self._born += [self._scan] * int(new.sum())
        self._sights += [0] * int(new.sum())
        for landmark in found[found != NONE].tolist():
            self._sights[landmark] += 1
        self._scan += 1
        return found

    def false_starts(self, landmarks: set[int]) -> list[int]:
        """Those of the `landmarks`, rays or points, that were seen too seldom at first; they are gone for good."""
        management = self._settings.map_management
        if management is None:
            return []
        old = self._scan - management.probation
        gone = [each for each in sorted(landmarks) if self._born[each] <= old and not self.is_confirmed(each)]
        self._gone.update(gone)
        return gone

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
        slots = self._matcher.jointly_compatible(count, gate, quantiles, self._settings.node_limit)
        doubtful = np.zeros(observations, dtype=bool)
        if self._settings.map_management is not None:
            margin, limit = self._settings.map_management.margin, self._settings.node_limit
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
