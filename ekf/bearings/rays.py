"""FIS (federated information sharing): undelayed initialisation of bearing-only landmarks.

A bearing does not determine a distance. The first bearing of a landmark therefore adds several members to the map:
Gaussian hypotheses of the position along the ray of this bearing. `RayInitialiser.observe` processes every later
bearing z with variance R:

1. compute the innovation nu_i of each member i and its variance Z_i; reject z if no member passes the gate;
2. multiply each weight by the likelihood of z, then normalise the weights of the ray;
3. prune members of small weight;
4. if one member is left, make it a point, and update it with z and variance R;
5. otherwise update member i with z and variance R / rho_i. The share rho_i is the weight of the member. Members with a
   share below MIN_SHARE are not updated. The sum of the shares is at most 1, so the ray receives no more information
   than z has.

Members are landmarks of the `LandmarkMap`, which computes innovations, updates and covariances.

Source: Sola, Monin, Devy and Lemaire, "Undelayed initialization in bearing only SLAM", IROS 2005. Equations 4.1 to 4.4
are those of the exercise (docs/practical.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.initialiser import RayRecorder
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import add_landmarks, remove_landmark
from slamgauge.ekf.maps.matching import innovations
from slamgauge.ekf.online_filter import NO_MEMBERS, Members
from slamgauge.ekf.settings import Rays

MIN_SHARE = 0.05  # members with a smaller share rho are not updated
SAME = 1.2  # ratio of distances below which the last two members are the same


@dataclass
class Ray:
    """Members of a landmark that is not a point yet (n members now).

    Attributes:
        members: (n,) ids of the members in the map.
        log_weights: (n,) logarithms of the weights Lambda_i; the sum of the weights is 1.
        numbers: (n,) numbers i of the members when the ray started, from 0.
        first_count: N_g, number of members when the ray started.
        failures: number of bearings in a row that failed the gate.
    """

    members: Int
    log_weights: Float
    numbers: Int
    first_count: int
    failures: int = 0


def distances_and_sigmas(settings: Rays) -> tuple[Float, Float]:
    """Return distances s_i (N_g,) [m] of the members of a new ray, and sigmas sigma_i (N_g,) [m] along the ray.

    N_g is the smallest number of members with which the last member i reaches s_max: s_i + sigma_i >= s_max.
    """
    s_1 = settings.s_min / (1.0 - settings.alpha)  # (4.1), so that s_1 - sigma_1 = s_min
    i = np.arange(settings.member_count)  # from 0: i - 1 of the exercise
    s = s_1 * np.float64(settings.beta) ** i  # (4.2), (4.3): s_i = beta^(i - 1) s_1
    return s, settings.alpha * s  # sigma_i = alpha s_i


class RayInitialiser:
    """Rays of a map. The methods are those of `Initialiser`."""

    def __init__(self, landmarks: LandmarkMap, settings: Rays) -> None:
        self._map = landmarks
        self._settings = settings
        self._rays: dict[int, Ray] = {}
        self._ids = Ids()
        self.log = RayRecorder()

    def observe(self, step: int, ids: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Update the observed rays, then start a ray for every other observed landmark.

        Args:
            step: step of the bearings, for the log.
            ids: (m,) distinct landmarks that are not points.
            values: (m, 1) their bearings [rad].
            covs: (m, 1, 1) variances [rad^2].

        Returns:
            The landmarks that became points: keys are ids of landmarks, values their ids in the map.
        """
        points: dict[int, int] = {}
        rows, members, shares = [], [], []
        for row, landmark in enumerate(ids):
            ray = self._rays.get(landmark)
            if ray is None or not self._weigh(step, landmark, values[row], covs[row]):
                continue
            self._prune(ray)
            if len(ray.members) == 1:
                points[landmark] = self._promote(step, landmark)
            updated, rho = self._shares(ray)
            members.append(updated)
            shares.append(rho)
            rows.append(np.full(len(updated), row))
        if rows:
            row, rho = np.concatenate(rows), np.concatenate(shares)[:, None, None]
            slots = self._map.state.slots_of(np.concatenate(members))
            self._map.correction.update(slots, values[row], covs[row] / rho)  # all members at once: R_i = R / rho_i
        for row, landmark in enumerate(ids):
            if landmark not in self._rays and landmark not in points:
                self._start(step, landmark, values[row], covs[row])
        return points

    def _start(self, step: int, landmark: int, value: Float, cov: Float) -> None:
        """Start a ray along a bearing (1,) with variance (1, 1)."""
        s, sigma = distances_and_sigmas(self._settings)
        count = len(s)
        # (4.4): the map appends x_p^i = p + s_i (cos, sin)(heading + z) and its covariances P_pX^i = J_r P, with the
        # whole state, and P_pp^i = J_r P J_r' + J_y diag(sigma_i^2, R) J_y'. The blocks of members i and j, which (4.4)
        # leaves empty, are J_r^i P J_r^j': members share the error of the robot.
        polar = np.column_stack([s, np.full(count, value[0])])  # (distance, bearing) of each member
        polar_covs = np.zeros((count, 2, 2))
        polar_covs[:, 0, 0] = sigma**2
        polar_covs[:, 1, 1] = cov[0, 0]
        members = self._ids.take(count)
        add_landmarks(self._map, members, polar, polar_covs)
        self._rays[landmark] = Ray(members, np.full(count, -math.log(count)), np.arange(count), count)
        self.log.begin(step, landmark, s)

    def _weigh(self, step: int, landmark: int, value: Float, cov: Float) -> bool:
        """Weigh the members of a ray by a bearing (1,) with variance (1, 1); return False if no member passes the gate.

        The ray is deleted after `Rays.lost_after` failures in a row.
        """
        ray, R = self._rays[landmark], cov[0, 0]
        slots, count = self._map.state.slots_of(ray.members), len(ray.members)
        innovation, Z = innovations(self._map, slots, np.tile(value, (count, 1)), np.tile(cov, (count, 1, 1)))
        nu, Z = innovation[:, 0], Z[:, 0, 0]  # Z_i = H_i P H_i' + R
        squared = nu**2 / Z  # squared Mahalanobis distance
        if squared.min() > self._settings.gate:
            ray.failures += 1
            if ray.failures >= self._settings.lost_after:
                self.forget(step, landmark)
            return False
        ray.failures = 0
        Z = np.where(Z > R, Z, 2.0 * math.pi)  # H = 0 for a member at the robot: every bearing is equally likely
        # Lambda_i <- Lambda_i lambda_i / sum, with lambda_i = exp(-nu_i^2 / (2 Z_i)) / sqrt(Z_i)
        ray.log_weights = _normalised(ray.log_weights - squared / 2.0 - np.log(Z) / 2.0)
        return True

    def _prune(self, ray: Ray) -> None:
        """Remove members with Lambda_i < tau / N_g, where tau is `Rays.threshold`.

        If two members remain at nearly the same distance, remove the one with the smaller weight. The heaviest member
        always remains.
        """
        kept = ray.log_weights >= math.log(self._settings.threshold / ray.first_count)
        if kept.sum() == 2:
            positions = self._map.state.entries(self._map.state.columns_of(ray.members[kept])).reshape(-1, 2)
            near, far = sorted(np.hypot(*(positions - self._map.state.robot[:2]).T))
            if far < SAME * near:
                kept[:] = False
        kept[np.argmax(ray.log_weights)] = True  # the heaviest member always remains
        self._remove(ray.members[~kept])
        ray.members, ray.numbers = ray.members[kept], ray.numbers[kept]
        ray.log_weights = _normalised(ray.log_weights[kept])

    def _promote(self, step: int, landmark: int) -> int:
        """Turn a ray's last member into a point; return its id in the map."""
        ray = self._rays.pop(landmark)
        self.log.end(step, landmark, int(ray.numbers[0]))
        return int(ray.members[0])

    def _shares(self, ray: Ray) -> tuple[Int, Float]:
        """Return the ids of the members that a bearing updates, and the share rho_i of its information for each."""
        weights, sharing = np.exp(ray.log_weights), self._settings.sharing
        if len(weights) == 1:  # a point
            return ray.members, np.ones(1)
        if sharing == "federated":
            updated = weights >= MIN_SHARE
            return ray.members[updated], weights[updated]  # rho_i = Lambda_i
        if sharing == "best":
            heaviest = np.argmax(weights)
            return ray.members[heaviest : heaviest + 1], np.ones(1)
        if sharing == "weights":
            return ray.members[:0], np.zeros(0)
        return ray.members, np.full(len(weights), 1.0 if sharing == "none" else 1.0 / len(weights))

    def forget(self, step: int, landmark: int) -> None:
        """Delete a ray and its members."""
        self._remove(self._rays.pop(landmark).members)
        self.log.end(step, landmark)

    def _remove(self, members: Int) -> None:
        for member in members.tolist():
            remove_landmark(self._map, int(self._map.state.slots_of(np.array([member]))[0]))

    @property
    def counts(self) -> dict[int, int]:
        """Number of members of each ray, by id of the landmark."""
        return {landmark: len(ray.members) for landmark, ray in self._rays.items()}

    def member_ids(self) -> dict[int, Int]:
        """Return the ids in the map of the members of each ray, by id of the landmark."""
        return {landmark: ray.members for landmark, ray in self._rays.items()}

    def members(self) -> Members:
        """Return every member of every ray."""
        if not self._rays:
            return NO_MEMBERS
        rays = self._rays.values()
        slots = self._map.state.slots_of(np.concatenate([ray.members for ray in rays]))
        return Members(
            landmark=np.repeat([*self._rays], [len(ray.members) for ray in rays]),
            number=np.concatenate([ray.numbers for ray in rays]),
            weight=np.exp(np.concatenate([ray.log_weights for ray in rays])),
            position=self._map.state.positions[slots],
            cov=self._map.state.position_covs[slots],
        )


def _normalised(log_weights: Float) -> Float:
    """Return the logarithms of the weights after division by their sum."""
    largest = log_weights.max()
    return log_weights - largest - math.log(np.exp(log_weights - largest).sum())
