"""Delayed initialisation of bearing-only landmarks: triangulation from a window of past poses.

While landmarks wait, the filter clones poses into the state, every `spacing` metres and at most `poses` of them. From
one clone to the next at most SCANS scans are used: each stores the increment from the last clone to the robot and its
covariance, which is added to the noise of the bearings. At each new clone a landmark is placed if its bearings
triangulate it (`slamgauge.triangulate`). Then all its bearings are linearised at the triangulated point:
r = H_x dx + H_f df + noise. With Q'H_f = [T; 0], the upper two rows give the landmark as a function of the poses, and
the other rows, which do not contain it, correct the poses. If every scan has a clone (`spacing` 0), this is exact apart
from the linearisation. Otherwise the increments count as independent of each other and of the state, which is an
approximation. If the innovation of the bearings is improbable, the landmark continues to wait.

A full window removes the clone whose neighbours are nearest to each other, which keeps a long baseline and bearings of
landmarks that left the view before they were placed: if re-observed, they close a loop. Clones with such bearings only
take at most half of the window; beyond that the oldest is removed. The cost of a step does not grow with time.
Jacobians are taken at the present estimate, whatever the correction.

Sources: Bailey, "Constrained initialisation for bearing-only SLAM", ICRA 2003 (delayed initialisation from past poses
in the state); Mourikis and Roumeliotis, "A multi-state constraint Kalman filter for vision-aided inertial
navigation", ICRA 2007 (cloned poses, projection on the null space).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from slamgauge.arrays import Float, Int
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_state import NewEntries
from slamgauge.ekf.online_filter import NO_MEMBERS, Members
from slamgauge.ekf.settings import FEWEST, Delayed
from slamgauge.se2 import between, compose, rotation, wrap
from slamgauge.sensors import bearing_gradient
from slamgauge.triangulation import triangulate

IMPROBABLE = 1e-3  # probability that correct bearings have to wait
SCANS = 5  # most scans that are used from one clone to the next


@dataclass(frozen=True)
class Sight:
    """A bearing [rad], its variance [rad^2], and its pose: a body-frame increment from a clone, with covariance."""

    clone: int
    increment: Float  # (3,)
    increment_cov: Float  # (3, 3)
    bearing: float
    variance: float


class DelayedInitialiser:
    """The waiting landmarks of a map, with the methods of `rays.RayInitialiser`."""

    step = 0  # not needed

    def __init__(self, landmarks: LandmarkMap, settings: Delayed) -> None:
        self._map = landmarks
        self._settings = settings
        self._sights: dict[int, list[Sight]] = {}
        self._clones: list[int] = []  # in the order of time; a clone has two ids in the map: this and the one below
        self._scans = 0  # used since the last clone

    def copy(self) -> DelayedInitialiser:
        """Return a copy that later observations do not change; both share the map."""
        twin = copy(self)
        sights = {landmark: [*each] for landmark, each in self._sights.items()}
        vars(twin).update(_sights=sights, _clones=[*self._clones])
        return twin

    @property
    def counts(self) -> dict[int, int]:
        """0 members for each waiting landmark."""
        return dict.fromkeys(self._sights, 0)

    def observe(self, ids: list[int], values: Float, covs: Float) -> None:
        """Store the bearings if the robot has moved, then place the landmarks that have enough."""
        moved = self._distance_from_clone()
        if not ids or moved < self._settings.spacing * self._scans / SCANS:
            return
        is_cloned = moved >= self._settings.spacing
        if is_cloned:
            self._clone_pose()
        self._scans += 1
        pose = (self._clones[-1], *self._increment_from_clone())
        for row, landmark in enumerate(ids):
            self._sights.setdefault(landmark, []).append(Sight(*pose, values[row, 0], covs[row, 0, 0]))
        if not is_cloned:
            return
        if len(self._clones) > self._settings.poses:
            self._drop_clone(self._dispensable(ids))
        for landmark in ids:
            self._place(landmark)
        used = {sight.clone for sights in self._sights.values() for sight in sights}
        for clone in [each for each in self._clones if each not in used]:
            self._drop_clone(clone)

    def members(self) -> Members:
        """Return no rows: a waiting landmark has no position."""
        return NO_MEMBERS

    def log(self, _members: Int) -> None:
        """Return None, because this initialisation has no rays."""

    def _distance_from_clone(self) -> float:
        """Return the robot's distance from the last clone [m]; infinite without clones."""
        if not self._clones:
            return math.inf
        last = self._map.entries(self._columns(self._clones[-1:])[0, :2])
        return float(np.hypot(*(self._map.robot[:2] - last)))

    def _increment_from_clone(self) -> tuple[Float, Float]:
        """Return the increment (3,) from the last clone to the robot, and its covariance (3, 3)."""
        if self._scans == 1:
            return np.zeros(3), np.zeros((3, 3))
        columns = np.append([0, 1, 2], self._columns(self._clones[-1:]))
        robot, clone = self._map.entries(columns).reshape(2, 3)
        increment, turn = between(clone, robot), np.eye(3)
        turn[:2, :2] = rotation(clone[2]).T
        by_clone = -turn
        by_clone[:2, 2] = [increment[1], -increment[0]]
        jacobian = np.column_stack([turn, by_clone])
        return increment, jacobian @ self._map.covariances(columns, columns) @ jacobian.T

    def _clone_pose(self) -> None:
        """Append the pose as two slots: the position, and the heading with a zero."""
        jacobian = np.zeros((4, 3))
        jacobian[:3] = np.eye(3)
        ids = self._map.take_hidden_ids(2)
        values = np.append(self._map.robot, 0.0)
        self._map.add_entries(ids, NewEntries(values, np.arange(3), jacobian, np.zeros((4, 4)), [True, False]))
        self._clones.append(int(ids[0]))
        self._scans = 0

    def _dispensable(self, ids: list[int]) -> int:
        """Return the clone to remove while the landmarks `ids` are in view."""
        useful = {sight.clone for landmark in ids for sight in self._sights[landmark]}
        past = [clone for clone in self._clones if clone not in useful]
        if len(past) > self._settings.poses // 2:
            return past[0]
        positions = self._map.entries(self._columns(self._clones)[:, :2].ravel()).reshape(-1, 2)
        gaps = np.hypot(*(positions[2:] - positions[:-2]).T)
        return self._clones[1 + int(np.argmin(gaps))]

    def _place(self, landmark: int) -> None:
        """Add a landmark to the map if its bearings place it."""
        sights = self._sights[landmark]
        if len(sights) < FEWEST:
            return
        used, index = np.unique([sight.clone for sight in sights], return_inverse=True)
        columns = self._columns(used)
        clones = self._map.entries(columns.ravel()).reshape(-1, 3)[index]
        poses = compose(clones, np.array([sight.increment for sight in sights]))
        bearings, variances = np.array([(sight.bearing, sight.variance) for sight in sights]).T
        found = triangulate(poses, bearings, variances, self._settings.sure)
        if not found.placed:
            return
        residual, of_clones, of_increments, of_landmark = linearise_bearings(poses, clones, bearings, found.landmark)
        increment_covs = np.array([sight.increment_cov for sight in sights])
        sigmas = np.sqrt(variances + np.einsum("ni,nij,nj->n", of_increments, increment_covs, of_increments))
        jacobian = np.zeros((len(sights), *columns.shape))
        jacobian[np.arange(len(sights)), index] = of_clones / sigmas[:, None]
        jacobian, columns = jacobian.reshape(len(sights), -1), columns.ravel()
        Q, T = np.linalg.qr(of_landmark / sigmas[:, None], mode="complete")
        residual, jacobian, inverse = Q.T @ (residual / sigmas), Q.T @ jacobian, np.linalg.inv(T[:2])
        S = jacobian[2:] @ self._map.covariances(columns, columns) @ jacobian[2:].T + np.eye(len(sights) - 2)
        if residual[2:] @ np.linalg.solve(S, residual[2:]) > chdtri(len(sights) - 2, IMPROBABLE):
            return
        position = found.landmark + inverse @ residual[:2]
        new = NewEntries(position, columns, -inverse @ jacobian[:2], inverse @ inverse.T, [True])
        self._map.add_entries(np.array([landmark]), new)
        self._map.update_linear(columns, jacobian[2:], residual[2:], np.eye(len(sights) - 2))
        del self._sights[landmark]

    def _columns(self, clones: ArrayLike) -> Int:
        """Return the state entries (c, 3) of the clones' (c,) x, y and heading."""
        ids = np.add.outer(np.asarray(clones), [0, -1])
        return self._map.columns_of(ids.ravel()).reshape(-1, 4)[:, :3]

    def _drop_clone(self, clone: int) -> None:
        self._clones.remove(clone)
        for landmark, sights in [*self._sights.items()]:
            self._sights[landmark] = [sight for sight in sights if sight.clone != clone]
            if not self._sights[landmark]:
                del self._sights[landmark]
        self._map.remove(clone, clone - 1)


def linearise_bearings(
    poses: Float, clones: Float, bearings: Float, landmark: Float
) -> tuple[Float, Float, Float, Float]:
    """Return residuals (m,) [rad] of bearings from poses (m, 3) to a landmark (2,).

    The other results are the derivatives of each predicted bearing by the clone (m, 3) of its pose, by the increment
    (m, 3) from the clone to the pose, and by the landmark (m, 2).
    """
    offset = landmark - poses[:, :2]
    gradient = np.column_stack(bearing_gradient(offset[:, 0], offset[:, 1], (offset**2).sum(axis=1)))
    residual = wrap(bearings + poses[:, 2] - np.arctan2(offset[:, 1], offset[:, 0]))
    arm = poses[:, :2] - clones[:, :2]
    by_heading = gradient[:, 0] * arm[:, 1] - gradient[:, 1] * arm[:, 0] - 1.0
    by_increment = np.einsum("ni,nij->nj", -gradient, rotation(clones[:, 2]))
    by_turn = np.full(len(poses), -1.0)
    of_clones, of_increments = np.column_stack([-gradient, by_heading]), np.column_stack([by_increment, by_turn])
    return residual, of_clones, of_increments, gradient
