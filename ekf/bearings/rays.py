"""Undelayed initialisation of bearing-only landmarks (FIS): each starts as a ray of members and becomes a point.

A first bearing puts members at distances in geometric progression along the ray, each with a standard deviation
that grows with its distance. Later bearings weigh the members; the improbable ones go, and the last one is an
ordinary landmark. Until then a measurement is shared out among the members (federated information sharing): member
i is corrected with R / rho_i and the shares rho_i add up to one at most, so that the ray receives no more
information than the measurement has.

Members are landmarks of the `LandmarkMap`; the logic here is the same for all corrections.

Sources: Sola, Monin, Devy and Lemaire, "Undelayed initialization in bearing only SLAM", IROS 2005; the practical,
equations 4.1 to 4.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.ray_recorder import RayRecorder
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.matching import innovations
from slamgauge.ekf.maps.members import NO_MEMBERS, Members
from slamgauge.ekf.settings.initialisation import Rays


@dataclass
class Ray:
    """Members of a landmark that is not a point yet: ids in the map, log weights (normalised), numbers at birth."""

    members: Int
    log_weights: Float
    numbers: Int
    born_with: int
    failures: int = 0


MIN_SHARE = 0.05  # members with a smaller share are not corrected
SAME = 1.2  # two members with distances nearer than this ratio are one


class RayInitialiser:
    """The rays of a map; see `Initialiser` for its methods."""

    def __init__(self, landmarks: LandmarkMap, settings: Rays) -> None:
        self._map = landmarks
        self._settings = settings
        self._rays: dict[int, Ray] = {}
        self._ids = Ids()
        self.log = RayRecorder()

    @property
    def counts(self) -> dict[int, int]:
        """Landmarks that are rays, and how many members each has."""
        return {landmark: len(ray.members) for landmark, ray in self._rays.items()}

    def observe(self, step: int, ids: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Weigh the rays that were seen, correct their members in one update, then start rays for what is new."""
        rows, members, shares, points = [], [], [], dict[int, int]()
        known = [(row, landmark) for row, landmark in enumerate(ids) if landmark in self._rays]
        for row, landmark in known:
            given, share = self._weigh(step, landmark, values[row : row + 1], covs[row : row + 1])
            rows.append(np.full(len(given), row))
            members.append(given)
            shares.append(share)
            if len(given) == 1 and landmark not in self._rays:
                points[landmark] = int(given[0])
        if rows:
            row = np.concatenate(rows)
            share = np.concatenate(shares)[:, None, None]
            self._map.correct(self._map.slots_of(np.concatenate(members)), values[row], covs[row] / share)
        for row, landmark in enumerate(ids):
            if landmark not in self._rays and landmark not in points:
                self._begin(step, landmark, values[row], covs[row])
        return points

    def members(self) -> Members:
        """Every member of every ray."""
        if not self._rays:
            return NO_MEMBERS
        rays = self._rays.values()
        slots = self._map.slots_of(np.concatenate([ray.members for ray in rays]))
        return Members(
            landmark=np.repeat([*self._rays], [len(ray.members) for ray in rays]),
            number=np.concatenate([ray.numbers for ray in rays]),
            weight=np.exp(np.concatenate([ray.log_weights for ray in rays])),
            position=self._map.positions[slots],
            cov=self._map.position_covs[slots],
        )

    def member_ids(self) -> dict[int, Int]:
        """Ids of every ray's members."""
        return {landmark: ray.members for landmark, ray in self._rays.items()}

    def forget(self, step: int, landmark: int) -> None:
        """Take a ray out of the state; it is lost."""
        self._remove(self._rays.pop(landmark).members)
        self.log.end(step, landmark)

    def _weigh(self, step: int, landmark: int, value: Float, cov: Float) -> tuple[Int, Float]:
        """Weigh the members of a ray by a bearing (1, 1) with covariance (1, 1, 1); prune, collapse, or lose it.

        Returns the members that the bearing corrects, and the share rho of each.
        """
        ray, settings = self._rays[landmark], self._settings
        count = len(ray.members)
        slots = self._map.slots_of(ray.members)
        values, covs = np.repeat(value, count, axis=0), np.repeat(cov, count, axis=0)
        innovation, Z = innovations(self._map, slots, values, covs)
        squared = innovation[:, 0] ** 2 / Z[:, 0, 0]
        spread = np.where(Z[:, 0, 0] > cov[0, 0, 0], Z[:, 0, 0], 2.0 * math.pi)  # at the robot: any bearing alike
        if squared.min() > settings.gate:
            ray.failures += 1
            if ray.failures >= settings.lost_after:
                self.forget(step, landmark)
            return ray.members[:0], np.zeros(0)
        ray.failures = 0
        weights = _normalised(ray.log_weights - squared / 2.0 - np.log(spread) / 2.0)
        self._prune(ray, weights)
        if len(ray.members) == 1:
            del self._rays[landmark]
            self.log.end(step, landmark, int(ray.numbers[0]))
            return ray.members, np.ones(1)
        return self._shares(ray)

    def _prune(self, ray: Ray, weights: Float) -> None:
        """Give the members these log weights; those that are improbable now, or one with another, go."""
        kept = weights >= math.log(self._settings.threshold / ray.born_with)
        if kept.sum() == 2:
            members = self._map.entries(self._map.columns_of(ray.members[kept])).reshape(-1, 2)
            near, far = sorted(np.hypot(*(members - self._map.robot[:2]).T))
            if far < SAME * near:
                kept[:] = False
        kept[np.argmax(weights)] = True
        self._remove(ray.members[~kept])
        ray.members, ray.numbers, ray.log_weights = ray.members[kept], ray.numbers[kept], _normalised(weights[kept])

    def _shares(self, ray: Ray) -> tuple[Int, Float]:
        weights = np.exp(ray.log_weights)
        sharing = self._settings.sharing
        if sharing == "federated":
            corrected = weights >= MIN_SHARE
            return ray.members[corrected], weights[corrected]
        if sharing == "best":
            heaviest = np.argmax(weights)
            return ray.members[heaviest : heaviest + 1], np.ones(1)
        if sharing == "weights":
            return ray.members[:0], np.zeros(0)
        return ray.members, np.full(len(weights), 1.0 if sharing == "none" else 1.0 / len(weights))

    def _begin(self, step: int, landmark: int, value: Float, cov: Float) -> None:
        """Put the members of a new ray along a bearing (1,) with covariance (1, 1)."""
        distances = self._settings.distances()
        count = len(distances)
        members = self._ids.take(count)
        seen = np.column_stack([distances, np.full(count, value[0])])
        seen_covs = np.zeros((count, 2, 2))
        seen_covs[:, 0, 0] = (self._settings.alpha * distances) ** 2
        seen_covs[:, 1, 1] = cov[0, 0]
        self._map.add(members, seen, seen_covs)
        self._rays[landmark] = Ray(members, np.full(count, -math.log(count)), np.arange(count), count)
        self.log.begin(step, landmark, distances)

    def _remove(self, members: Int) -> None:
        for member in members.tolist():
            self._map.remove(int(self._map.slots_of(np.array([member]))[0]))


def _normalised(log_weights: Float) -> Float:
    """Log weights that add up to one."""
    largest = log_weights.max()
    return log_weights - largest - math.log(np.exp(log_weights - largest).sum())
