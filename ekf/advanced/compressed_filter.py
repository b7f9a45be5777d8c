"""The standard and the right-invariant filter on large maps: compressed updates of the robot's surroundings.

Steps in an area A change the rest B of the map only through the entries of A on entry (index 0). Three small matrices,
the account, store this effect exactly:

    P_AB = T P_AB0,    P_BB = P_BB0 + P_BA0 C P_AB0,    x_B = x_B0 + P_BA0 g

with T = I, C = 0, g = 0 on entry; T <- F T in a prediction; in an update with whitened Jacobian H
(S = I) and innovation y: N = H T, C <- C - N'N, g <- g + N'y, T <- T - (H P)'N. With its account, a step costs about
four times as much as in a map of the area alone. The account is applied to the rest of the map when the robot leaves
the area, or observes a landmark outside it.

The right-invariant filter also moves every landmark by V dx, V = v_cos I + v_sin J, and changes its error by
J V dx times that of the heading (see `kernels.corrections`). Both only mix x and y of a landmark: they multiply the
landmark's rows of P_BA0 by V and J from the left. The account therefore uses twice as many rows,

    Q = [P_AB0; P_AB0 J_B']  instead of P_AB0,  with T = [I, 0] on entry

where J_B is block diagonal with J for each landmark. The formulas above stay the same. A row m = [m_1, m_2] moves the
landmarks by Q'm'; the row m J = [-m_2, m_1] moves them by the same vectors rotated by 90 degrees. With m = y'N of the
correction, c = m V J, the heading's row t of T, and u and P of the area after the retraction (u as in
`kernels.corrections`), the retraction after an update is

    g <- g + (m V)',    T <- T + u t + P_A,theta c,    C <- C + c't + t'c + P_theta,theta c'c

Source: Guivant and Nebot, IEEE Transactions on Robotics and Automation 17(3), 2001 (standard filter). The account of
the right-invariant filter is derived here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.compressed_update import Account, update_area
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.ekf.maps.correction_table import RULES, WHOLE_SCAN, Correction, Rule, rule_of
from slamgauge.ekf.maps.input_checks import (
    ids_of,
    require_gate,
    require_ids,
    require_radius,
    require_robustness,
    require_room,
    require_sensor,
    rows_of,
    start_of,
)
from slamgauge.ekf.maps.map_edits import replace_map
from slamgauge.ekf.online_filter import PointFilter
from slamgauge.ekf.settings import PLAIN, Robustness
from slamgauge.ekf.slam_filter import SlamFilter
from slamgauge.errors import UserError
from slamgauge.memory import require_memory
from slamgauge.recording import Observations
from slamgauge.sensors import PLACING, SENSORS

ROWS = 128  # rows of the map's covariance that are updated in one product


class CompressedFilter(PointFilter):
    """EKF-SLAM with known association, standard or right-invariant; equal to `SlamFilter`, faster on large maps.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) covariance of the start pose.
        area_radius: landmarks within this distance [m] of the robot form an area. The robot leaves it after moving a
            third of this distance. Recommended: 1.5 times the sensor's range.
        correction: `standard` or `right-invariant` (see `kernels.corrections`).
        robust: treatment of outliers.

    Raises:
        UserError: an invalid sensor, correction, prior or radius.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        area_radius: float,
        correction: Correction = "standard",
        robust: Robustness = PLAIN,
    ) -> None:
        require_sensor(sensor, PLACING)
        rule = rule_of(correction)
        self._is_invariant = rule == RULES["right-invariant"]
        if not (self._is_invariant or rule == RULES["standard"]):
            raise UserError(
                f"correction: {correction!r} has no account of an area; use standard or right-invariant, or SlamFilter"
            )
        require_radius(area_radius)
        self._sensor = sensor
        self._area_radius = area_radius
        self._robust = require_robustness(robust)
        self._ids: Int = np.zeros(0, dtype=np.int64)
        self._origin, self._mean, start_cov = start_of(prior_mean, prior_cov)
        self._room = start_cov.copy()
        self._enter_area(self._ids)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._local.pose + np.append(self._origin, 0.0)

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._local.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks, in the order of their first observation."""
        return np.concatenate([self._ids, self._local.landmark_ids[self._entered :]])

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m]; applies the account of the area."""
        self._update_map(self._local.landmark_ids)
        return self._mean[3:].reshape(-1, 2) + self._origin

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2]; applies the account of the area."""
        self._update_map(self._local.landmark_ids)
        first = np.arange(3, len(self._mean), 2)[:, None, None]
        return self._cov[first + np.arange(2)[:, None], first + np.arange(2)]

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of robot and landmarks; applies the account of the area."""
        self._update_map(self._local.landmark_ids)
        return self._cov.copy()

    @property
    def _cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance on entry to the area, a view of the allocated array."""
        return self._room[: len(self._mean), : len(self._mean)]

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `SlamFilter.predict`."""
        before = self._local.pose
        self._local.predict(increment, cov)
        moved = self._local.pose - before
        T = self._account.T
        T[0] -= moved[1] * T[2]
        T[1] += moved[0] * T[2]

    def update(self, observations: Observations, gate: float | None = None) -> tuple[float, int]:
        """Correct with all observations of one step, then map new landmarks; see `SlamFilter.update`."""
        values, covs = rows_of(observations, SENSORS[self._sensor].dim)
        ids = ids_of(observations, len(values))
        require_gate(gate)
        outside = np.isin(ids, self._ids) & ~np.isin(ids, self._local.landmark_ids)
        travelled = np.hypot(*(self._local.pose - self._entry)[:2])
        if outside.any() or travelled > self._area_radius / 3.0:
            require_ids(ids)
            self._local.map.correction.require_sound(values, covs)
            self._update_map(ids)
        account = self._account
        known = np.isin(ids, self._local.landmark_ids).all() and len(np.unique(ids)) == len(ids)
        if not known:  # a later part of the update may raise
            self._account = Account(account.T.copy(), account.C.copy(), account.g.copy(), account.is_invariant)
        try:
            result = self._local.update(observations, gate)
        except BaseException:
            self._account = account
            raise
        self._account_for_new_landmarks(self._local.pose, self._local.landmarks.ravel())
        return result

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations, -1 for a rejected observation."""
        return self._local.associated

    def _account_for_new_landmarks(self, pose: Float, landmarks: Float) -> None:
        """Append rows of T for newly mapped ones among the `landmarks` (2L,): J_r times the robot's rows."""
        T = self._account.T
        offsets = landmarks[len(T) - 3 :].reshape(-1, 2) - pose[:2]
        if len(offsets):
            rows = np.repeat(T[None, :2], len(offsets), axis=0)
            rows[:, 0] -= offsets[:, 1:] * T[2]
            rows[:, 1] += offsets[:, :1] * T[2]
            self._account = self._account._replace(T=np.concatenate([T, rows.reshape(-1, T.shape[1])]))

    def _update_local(self, sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
        state, size = belief.state, belief.size
        self._account_for_new_landmarks(state[:3], state[3:size])  # a scan may observe a new landmark twice
        return update_area(sensor, belief, count, work, self._account)

    def _enter_area(self, seen: Int) -> None:
        """Start an account for the landmarks around the robot and the observed ids `seen`."""
        self._entry = self._mean[:3].copy()
        positions = self._mean[3:].reshape(-1, 2)
        distances = np.hypot(*(positions - self._mean[:2]).T)
        near = np.flatnonzero((distances <= self._area_radius) | np.isin(self._ids, seen))
        self._area = np.concatenate([np.arange(3), (3 + 2 * near[:, None] + np.arange(2)).ravel()])
        self._entered = len(near)
        area_cov = self._cov[np.ix_(self._area, self._area)]
        self._local = SlamFilter(
            self._sensor,
            self._mean[:3],
            area_cov[:3, :3],
            Rule(self._update_local, block=WHOLE_SCAN),
            landmarks=len(near) + 32,
            robust=self._robust,
        )
        replace_map(self._local.map, self._ids[near], positions[near], area_cov)
        size = len(self._area)
        rows = 2 * size if self._is_invariant else size
        self._account = Account(np.eye(size, rows), np.zeros((rows, rows)), np.zeros(rows), self._is_invariant)

    def _update_map(self, seen: Int) -> None:
        """Apply the account to the whole map, and enter the area around the robot."""
        area, old = self._area, len(self._mean)
        added = self._local.landmark_ids[self._entered :]
        size = old + 2 * len(added)
        self._grow(size, size + size // 4)  # may raise, so it is called before any change
        now = np.concatenate([area, np.arange(old, size)])
        known = self._cov[area]
        if self._is_invariant:
            known = np.vstack([known, turned(known)])
        C = np.triu(self._account.C) + np.triu(self._account.C, 1).T
        for first in range(0, old, ROWS):  # includes rows of the area, which are overwritten below
            rows = slice(first, min(first + ROWS, old))
            self._cov[rows] += (C @ known[:, rows]).T @ known
        mean = np.append(self._mean + known.T @ self._account.g, np.zeros(size - old))
        mean[now] = np.concatenate([self._local.pose, self._local.landmarks.ravel()])
        self._mean = mean
        cov = self._cov
        cov[now, :old] = self._account.T @ known
        cov[:old, now] = cov[now, :old].T
        cov[np.ix_(now, now)] = self._local.cov
        self._ids = np.concatenate([self._ids, added])
        self._enter_area(seen)

    def reserve(self, landmarks: int) -> None:
        """Allocate a map of `landmarks`; without this call the filter enlarges its arrays by copying the covariance."""
        size = 3 + 2 * require_room(landmarks)
        self._grow(size, size)

    def _grow(self, size: int, room: int) -> None:
        """Allocate a covariance with `room` entries if `size` exceeds the present one; unused pages take no memory."""
        if size > len(self._room):
            require_memory(8.0 * size * size, f"the covariance of {(size - 3) // 2} landmarks", "give fewer landmarks")
            before, used = self._cov, len(self._mean)
            self._room = np.zeros((room, room))
            self._room[:used, :used] = before


def turned(rows: Float) -> Float:
    """Return rows (a, 3 + 2L) times J_B': (x, y) of each landmark becomes (-y, x); the robot's entries stay."""
    result = rows.copy()
    result[:, 3::2], result[:, 4::2] = -rows[:, 4::2], rows[:, 3::2]
    return result
