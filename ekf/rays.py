"""Bearing-only SLAM with undelayed initialisation: a landmark begins as a ray of members and becomes a point.

A first bearing puts members at distances in geometric progression along the ray, each with a standard deviation
that grows with its distance. Later bearings weigh the members; the improbable ones go, and the last one is an
ordinary landmark. Until then a measurement is shared out among the members (federated information sharing): member
i is corrected with R / rho_i and the shares rho_i add up to one at most, so that the ray receives no more
information than the measurement has.

Members are landmarks of `SlamFilter`; whatever its correction, the logic here is the same.

Sources: Sola, Monin, Devy and Lemaire, "Undelayed initialization in bearing only SLAM", IROS 2005; the practical,
equations 4.1 to 4.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ekf.filter import Correction, SlamFilter
from slam2d import Float, Int, Observations

Sharing = Literal["federated", "uniform", "none", "best", "weights"]


@dataclass(frozen=True)
class Rays:
    """How rays are made, weighed and shared out.

    Attributes:
        alpha: a member's standard deviation over its distance, below 1.
        beta: distance of a member over that of the one before, above 1.
        s_min: nearest distance of a landmark [m].
        s_max: farthest distance of a landmark [m]; no shorter than the sensor's range.
        threshold: tau; members with a weight below tau / (number of members at first) go.
        gate: largest squared Mahalanobis distance (1 degree of freedom) of the nearest member.
        lost_after: a ray whose every member fails the gate so many times in a row is deleted.
        sharing: `federated`; the others are there to see what it is worth: `uniform` shares, `none` (R to every
            member), `best` (R to the heaviest alone), `weights` (no corrections before the ray is a point).
    """

    alpha: float = 0.3
    beta: float = 2.0
    s_min: float = 1.0
    s_max: float = 10.0
    threshold: float = 1e-3
    gate: float = 9.0
    lost_after: int = 3
    sharing: Sharing = "federated"

    def __post_init__(self) -> None:
        rules = (
            (0.0 < self.alpha < 1.0, f"alpha: {self.alpha} is no share of a distance; choose it above 0 and below 1"),
            (self.beta > 1.0, f"beta: {self.beta} makes no progression; choose it above 1"),
            (0.0 < self.s_min < self.s_max, f"s_max: {self.s_max} m must lie beyond s_min, {self.s_min} m, above 0"),
            (0.0 < self.threshold < 1.0, f"threshold: {self.threshold} prunes all or nothing; choose it in (0, 1)"),
            (self.gate > 0.0, f"gate: {self.gate} lets nothing pass; choose it above 0"),
        )
        for holds, mistake in rules:
            if not holds:
                raise ValueError(mistake)

    def distances(self) -> Float:
        """Distances (N_g,) of the members [m]."""
        ratio = (1.0 - self.alpha) / (1.0 + self.alpha) * self.s_max / self.s_min
        count = max(1 + math.ceil(math.log(ratio) / math.log(self.beta)), 1)
        return self.s_min / (1.0 - self.alpha) * np.float64(self.beta) ** np.arange(count)


@dataclass
class Ray:
    """Members of a landmark that is no point yet: their ids in the filter, and log weights (normalised)."""

    members: Int
    log_weights: Float
    born_with: int
    failures: int = 0


MIN_SHARE = 0.05  # members with a smaller share are not corrected
SAME = 1.2  # two members with distances nearer than this ratio are one


class RayFilter:
    """Online bearing-only SLAM with known association.

    Args:
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `SlamFilter`.
        rays: see `Rays`.
    """

    def __init__(
        self, prior_mean: ArrayLike, prior_cov: ArrayLike, correction: Correction = "standard", rays: Rays | None = None
    ) -> None:
        self._slam = SlamFilter("bearing", prior_mean, prior_cov, correction)
        self._settings = rays or Rays()
        self._rays: dict[int, Ray] = {}
        self._points: dict[int, int] = {}  # landmark: its id in the filter
        self._members = 0  # ids given so far

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._slam.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._slam.pose_cov

    @property
    def cov(self) -> Float:
        """(3 + 2n, 3 + 2n) covariance of the robot and all n points and members."""
        return self._slam.cov

    @property
    def ray_members(self) -> dict[int, int]:
        """Landmarks that are still rays, and how many members each has."""
        return {name: len(ray.members) for name, ray in self._rays.items()}

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks, points and rays."""
        return np.array([*self._points, *self._rays], dtype=np.int64)

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m]; of a ray that of its heaviest member."""
        return self._slam.landmarks[self._heaviest()]

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]; of a ray that of its heaviest member."""
        return self._slam.landmark_covs[self._heaviest()]

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `SlamFilter.predict`."""
        self._slam.predict(increment, cov)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Weigh rays, correct with all bearings of one step, then begin rays for what is new.

        Returns:
            The normalised innovation squared of the points and its degrees of freedom.
        """
        ids, values, covs = observations
        if ids is None:
            raise ValueError("landmark: this filter needs known association; give the ids of the observations")
        names = ids.tolist()
        points = [row for row, name in enumerate(names) if name in self._points]
        slots = self._slam.slots_of(np.array([self._points[names[row]] for row in points], dtype=np.int64))
        result = self._slam.correct(slots, values[points], covs[points])
        rows, members, shares = self._weigh_rays(names, values, covs)
        self._slam.correct(self._slam.slots_of(members), values[rows], covs[rows] / shares[:, None, None])
        for row, name in enumerate(names):
            if name not in self._rays and name not in self._points:
                self._begin(name, values[row], covs[row])
        return result

    def _weigh_rays(self, names: list[int], values: Float, covs: Float) -> tuple[Int, Int, Float]:
        """Weigh the rays that were seen; rows of the scan, members to be corrected and their shares."""
        rows, members, shares = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
        for row, name in enumerate(names):
            if name in self._rays:
                given, share = self._weigh(name, values[row : row + 1], covs[row : row + 1])
                rows.append(np.full(len(given), row))
                members.append(given)
                shares.append(share)
        return np.concatenate(rows), np.concatenate(members), np.concatenate(shares)

    def _weigh(self, name: int, value: Float, cov: Float) -> tuple[Int, Float]:
        """Weigh the members of a ray by a bearing (1, 1) with covariance (1, 1, 1); prune, collapse, or lose it.

        Returns the members that the bearing corrects, and the share rho of each.
        """
        ray, settings = self._rays[name], self._settings
        count = len(ray.members)
        slots = self._slam.slots_of(ray.members)
        innovation, Z = self._slam.innovations(slots, np.repeat(value, count, axis=0), np.repeat(cov, count, axis=0))
        squared = innovation[:, 0] ** 2 / Z[:, 0, 0]
        if squared.min() > settings.gate:
            ray.failures += 1
            if ray.failures >= settings.lost_after:
                self._remove(ray.members)
                del self._rays[name]
            return ray.members[:0], np.zeros(0)
        ray.failures = 0
        weights = _normalised(ray.log_weights - squared / 2.0 - np.log(Z[:, 0, 0]) / 2.0)
        kept = weights >= math.log(settings.threshold / ray.born_with)
        if kept.sum() == 2:
            near, far = sorted(np.hypot(*(self._slam.landmarks[slots[kept]] - self._slam.pose[:2]).T))
            if far < SAME * near:
                kept[:] = False
        kept[np.argmax(weights)] = True
        self._remove(ray.members[~kept])
        ray.members, ray.log_weights = ray.members[kept], _normalised(weights[kept])
        if len(ray.members) == 1:
            self._points[name] = int(ray.members[0])
            del self._rays[name]
            return ray.members, np.ones(1)
        return self._shares(ray)

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

    def _begin(self, name: int, value: Float, cov: Float) -> None:
        """Put the members of a new ray along a bearing (1,) with covariance (1, 1)."""
        distances = self._settings.distances()
        members = self._members + np.arange(len(distances))
        self._members += len(distances)
        sights = np.column_stack([distances, np.full(len(distances), value[0])])
        sight_covs = np.zeros((len(distances), 2, 2))
        sight_covs[:, 0, 0] = (self._settings.alpha * distances) ** 2
        sight_covs[:, 1, 1] = cov[0, 0]
        self._slam.add(members, sights, sight_covs)
        self._rays[name] = Ray(members, np.full(len(members), -math.log(len(members))), len(members))

    def _remove(self, members: Int) -> None:
        for member in members.tolist():
            self._slam.remove(int(self._slam.slots_of(np.array([member]))[0]))

    def _heaviest(self) -> Int:
        """Slots (L,) of the points and of the heaviest member of every ray."""
        heaviest = [int(ray.members[np.argmax(ray.log_weights)]) for ray in self._rays.values()]
        return self._slam.slots_of(np.array([*self._points.values(), *heaviest], dtype=np.int64))


def _normalised(log_weights: Float) -> Float:
    """Log weights that add up to one."""
    largest = log_weights.max()
    return log_weights - largest - math.log(np.exp(log_weights - largest).sum())
