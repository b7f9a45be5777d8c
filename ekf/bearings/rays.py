"""FIS (federated information sharing): undelayed initialisation of bearing-only landmarks.

A bearing does not determine a distance. The first bearing of a landmark therefore adds several members to the map:
Gaussian hypotheses of the position along the ray of this bearing. `RayInitialiser.observe` processes every later
bearing z with variance R:

1. compute the innovation nu_i of each member i and its variance Z_i; reject z if no member passes the gate;
2. multiply each weight by the likelihood of z, then normalise the weights of the ray (`weigh`);
3. prune members of small weight (`keep`);
4. if one member is left, make it a point, and update it with z and variance R;
5. otherwise update member i with z and variance R / rho_i. The share rho_i is the weight of the member (`shares`).
   Members with a share below MIN_SHARE are not updated. The sum of the shares is at most 1, so the ray receives no more
   information than z has.

Members are landmarks of the `LandmarkMap`, which computes innovations, updates and covariances.

Source: Sola, Monin, Devy and Lemaire, "Undelayed initialization in bearing only SLAM", IROS 2005. Equations 4.1 to 4.4
are those of the exercise (docs/exercise.md).
"""

from __future__ import annotations

import math
from copy import copy
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.online_filter import NO_MEMBERS, Members
from slamgauge.ekf.settings import Rays
from slamgauge.estimate import RayLog

MIN_SHARE = 0.05  # members with a smaller share rho are not updated
SAME = 1.2  # ratio of distances below which the last two members are the same


# --- equations, for the n members of one ray -----------------------------------------------------


def distances_and_sigmas(settings: Rays) -> tuple[Float, Float]:
    """Return distances s_i (N_g,) [m] of the members of a new ray, and sigmas sigma_i (N_g,) [m] along the ray.

    N_g is the smallest number of members with which the last member i reaches s_max: s_i + sigma_i >= s_max.
    """
    s_1 = settings.s_min / (1.0 - settings.alpha)  # (4.1), so that s_1 - sigma_1 = s_min
    i = np.arange(settings.member_count)  # from 0: i - 1 of the exercise
    s = s_1 * np.float64(settings.beta) ** i  # (4.2), (4.3): s_i = beta^(i - 1) s_1
    return s, settings.alpha * s  # sigma_i = alpha s_i


def as_observations(s: Float, sigma: Float, z: float, R: float) -> tuple[Float, Float]:
    """Return the members of a new ray as ranges and bearings (n, 2), with covariances (n, 2, 2), for (4.4).

    (4.4) is the mapping of a new landmark at range s_i and bearing z: the map appends
    x_p^i = p + s_i (cos, sin)(heading + z) and the covariances P_pX^i = J_r P with the whole state and
    P_pp^i = J_r P J_r' + J_y diag(sigma_i^2, R) J_y'. The blocks of members i and j, which (4.4) leaves empty, are
    J_r^i P J_r^j': members share the error of the robot.
    """
    covs = np.zeros((len(s), 2, 2))
    covs[:, 0, 0] = sigma**2
    covs[:, 1, 1] = R
    return np.column_stack([s, np.full(len(s), z)]), covs


def weigh(log_weights: Float, nu: Float, Z: Float, R: float) -> Float:
    """Return the logarithms (n,) of the weights Lambda_i after a bearing with innovations nu (n,) of variance Z (n,).

    Lambda_i <- Lambda_i lambda_i / sum, with the likelihood lambda_i = exp(-nu_i^2 / (2 Z_i)) / sqrt(2 pi Z_i).
    Z_i = R, the variance of the bearing, means H_i = 0: every bearing of a member at the robot is equally likely,
    lambda_i = 1 / (2 pi).
    """
    spread = np.where(Z > R, Z, 2.0 * math.pi)
    return normalised(log_weights - nu**2 / Z / 2.0 - np.log(spread) / 2.0)  # without the common factor 1 / sqrt(2 pi)


def keep(log_weights: Float, distances: Float, least: float) -> Marks:
    """Return which members (n,) remain: those with Lambda_i >= least, which is tau / N_g, and always the heaviest.

    If only two are left and their `distances` (n,) from the robot are nearly the same, the lighter one does not remain.
    """
    kept = log_weights >= math.log(least)
    if kept.sum() == 2:
        near, far = sorted(distances[kept])
        if far < SAME * near:
            kept[:] = False
    kept[np.argmax(log_weights)] = True
    return kept


def shares(weights: Float) -> Float:
    """Return the share rho_i (n,) of a bearing's information for each member: Lambda_i, or 0 below MIN_SHARE."""
    return np.where(weights >= MIN_SHARE, weights, 0.0)


def normalised(log_weights: Float) -> Float:
    """Return the logarithms of the weights after division by their sum."""
    largest = log_weights.max()
    return log_weights - largest - math.log(np.exp(log_weights - largest).sum())


# --- rays of a map -------------------------------------------------------------------------------


class Ray(NamedTuple):
    """A ray of n members, whose landmark is not a point yet; or a ray that has ended."""

    landmark: int  # id that its bearings have
    birth: int  # step
    members: Int  # (n,) ids in the map
    numbers: Int  # (n,) numbers i when the ray started, from 0
    log_weights: Float  # (n,) logarithms of the weights Lambda_i, whose sum is 1
    failures: int = 0  # bearings in a row that failed the gate
    end: int = NONE  # step
    survivor: int = NONE  # number of the member that became the point


class RayInitialiser:
    """Rays of a map. Members have hidden ids there; the last member of a ray gets the id of its landmark: a point."""

    def __init__(self, landmarks: LandmarkMap, settings: Rays) -> None:
        self._map, self._settings = landmarks, settings
        self._rays: dict[int, Ray] = {}  # key: landmark
        self._ended: list[Ray] = []
        self.step = 0

    def copy(self) -> RayInitialiser:
        """Return a copy that later observations do not change; both share the map."""
        twin = copy(self)
        vars(twin).update(_rays={**self._rays}, _ended=[*self._ended])
        return twin

    def observe(self, ids: list[int], values: Float, covs: Float) -> None:
        """Update the observed rays, then start a ray for every other landmark.

        Args:
            ids: (m,) distinct landmarks that are not points.
            values: (m, 1) their bearings [rad].
            covs: (m, 1, 1) variances [rad^2].
        """
        new: list[int] = []  # rows
        updates: list[tuple[Int, Int, Float]] = []  # rows, members, shares
        for row, landmark in enumerate(ids):
            if landmark not in self._rays:
                new.append(row)
                continue
            ray = self._rays[landmark]
            rows = np.full(len(ray.members), row)
            nu, Z = self._map.innovations(ray.members, values[rows], covs[rows])  # step 1: Z_i = H_i P H_i' + R
            if (nu[:, 0] ** 2 / Z[:, 0, 0]).min() > self._settings.gate:
                new += [row] if self._is_lost(ray) else []
                continue
            ray = self._pruned(ray, weigh(ray.log_weights, nu[:, 0], Z[:, 0, 0], covs[row, 0, 0]))  # steps 2 and 3
            rho = shares(np.exp(ray.log_weights))  # 1 for the last member
            updates.append((np.full(np.count_nonzero(rho), row), ray.members[rho > 0.0], rho[rho > 0.0]))
        if updates:  # steps 4 and 5: all members of all rays at once
            rows, members, rho = (np.concatenate(each) for each in zip(*updates, strict=True))
            self._map.update(members, values[rows], covs[rows] / rho[:, None, None])
        for row in new:
            self._start(ids[row], values[row, 0], covs[row, 0, 0])

    def _is_lost(self, ray: Ray) -> bool:
        """Count a bearing that failed the gate; delete the ray after `Rays.lost_after` of them in a row."""
        self._rays[ray.landmark] = ray._replace(failures=ray.failures + 1)
        if ray.failures + 1 < self._settings.lost_after:
            return False
        self._map.remove(*ray.members.tolist())
        self._end(ray)
        return True

    def _pruned(self, ray: Ray, log_weights: Float) -> Ray:
        """Return a ray with new weights, without the members of small weight; the last member becomes a point."""
        offsets = self._map.entries(self._map.columns_of(ray.members)).reshape(-1, 2) - self._map.robot[:2]
        kept = keep(log_weights, np.hypot(*offsets.T), self._settings.threshold / self._settings.member_count)
        self._map.remove(*ray.members[~kept].tolist())
        ray = ray._replace(members=ray.members[kept], numbers=ray.numbers[kept], failures=0)
        ray = self._rays[ray.landmark] = ray._replace(log_weights=normalised(log_weights[kept]))
        if len(ray.members) == 1:
            self._map.rename(int(ray.members[0]), ray.landmark)
            ray = self._end(ray._replace(members=np.array([ray.landmark]), survivor=int(ray.numbers[0])))
        return ray

    def _start(self, landmark: int, z: float, R: float) -> None:
        s, sigma = distances_and_sigmas(self._settings)
        members = self._map.take_hidden_ids(len(s))
        self._map.add(members, *as_observations(s, sigma, z, R))
        self._rays[landmark] = Ray(landmark, self.step, members, np.arange(len(s)), normalised(np.zeros(len(s))))

    def _end(self, ray: Ray) -> Ray:
        del self._rays[ray.landmark]
        self._ended.append(ray._replace(end=self.step))
        return ray

    @property
    def counts(self) -> dict[int, int]:
        """Number of members of each ray, by id of the landmark."""
        return {landmark: len(ray.members) for landmark, ray in self._rays.items()}

    def members(self) -> Members:
        """Return every member of every ray."""
        if not self._rays:
            return NO_MEMBERS
        landmark = np.repeat([*self._rays], [*self.counts.values()])
        members, numbers, log_weights = (
            np.concatenate([getattr(ray, name) for ray in self._rays.values()])
            for name in ("members", "numbers", "log_weights")
        )
        slots = self._map.slots_of(members)
        return Members(
            landmark, numbers, np.exp(log_weights), self._map.positions[slots], self._map.position_covs[slots]
        )

    def log(self, members: Int) -> RayLog:
        """Return the rays so far by birth, with the number of members (N+1,) after each step."""
        rays = sorted([*self._ended, *self._rays.values()], key=lambda ray: ray.birth)
        distances = distances_and_sigmas(self._settings)[0]

        def column(name: str) -> Int:
            return np.array([getattr(ray, name) for ray in rays], dtype=np.int64)

        return RayLog(
            landmark=column("landmark"),
            birth=column("birth"),
            end=column("end"),
            survivor=column("survivor"),
            distances=np.tile(distances, (len(rays), 1)),
            members=members,
        )
