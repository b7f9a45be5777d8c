"""Undelayed initialisation of bearing-only landmarks by inverse depth: one Gaussian from 2 m to infinity.

A landmark starts as an anchor a, the robot's position at the first bearing, the direction phi of that bearing in the
world frame, and the inverse omega of its distance: l = a + u(phi) / omega. A bearing measures the direction of
omega (a - p) + u(phi). This is nearly linear in omega and smooth through omega = 0, a landmark at infinity. A negative
omega is therefore accepted: later bearings correct it. A landmark that is three standard deviations beyond infinity is
deleted and initialised again. A landmark becomes a point when a point represents its depth as well.

Jacobians are taken at the present estimate, whatever the correction. Anchors are points and rotate with the map; phi
and omega do not (see `kernels.corrections`): this makes the right-invariant filter consistent.

Sources: Montiel, Civera and Davison, "Unified inverse depth parametrization for monocular SLAM", RSS 2006; Civera,
Davison and Montiel, IEEE Transactions on Robotics 24(5), 2008 (linearity index).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.initialiser import RayRecorder
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import NewEntries, add_entries, remove_landmark
from slamgauge.ekf.online_filter import NO_MEMBERS, Members
from slamgauge.ekf.settings import InverseDepth
from slamgauge.se2 import wrap
from slamgauge.sensor_models.bearing import gradient as bearing_gradient
from slamgauge.sensors import MIN_BEARING_DISTANCE

BEYOND_INFINITY = 3.0  # standard deviations of omega
VAGUE = 0.5  # rad; a bearing with a larger predicted standard deviation is too nonlinear, and is not used
FARTHEST = 10.0  # times the expected distance: reported position of a landmark with omega near zero or negative


@dataclass
class Depth:
    """A landmark in inverse depth: ids of its two slots, for the anchor and for (phi, omega)."""

    ids: Int
    failures: int = 0


class InverseDepthInitialiser:
    """The landmarks of a map in inverse depth. The methods are those of `Initialiser`."""

    def __init__(self, landmarks: LandmarkMap, settings: InverseDepth) -> None:
        self._map = landmarks
        self._settings = settings
        self._depths: dict[int, Depth] = {}
        self._ids = Ids()
        self.log = RayRecorder()

    @property
    def counts(self) -> dict[int, int]:
        """1 member for each landmark in inverse depth."""
        return dict.fromkeys(self._depths, 1)

    def observe(self, step: int, ids: list[int], values: Float, covs: Float) -> dict[int, int]:
        """Correct with all bearings in one update, convert well-known landmarks into points, start new ones."""
        seen = [row for row, landmark in enumerate(ids) if landmark in self._depths]
        if seen:
            self._correct(step, [ids[row] for row in seen], values[seen, 0], covs[seen, 0, 0])
        points: dict[int, int] = {}
        for row in seen:
            self._place_or_drop(step, ids[row], points)
        for row, landmark in enumerate(ids):
            if landmark not in self._depths and landmark not in points:
                self._begin(step, landmark, values[row, 0], covs[row, 0, 0])
        return points

    def members(self) -> Members:
        """Return each landmark at its estimated depth."""
        if not self._depths:
            return NO_MEMBERS
        positions, covs = zip(*(self._as_point(depth) for depth in self._depths.values()), strict=True)
        count = len(self._depths)
        landmark = np.array([*self._depths], dtype=np.int64)
        return Members(landmark, np.zeros(count, np.int64), np.ones(count), np.array(positions), np.array(covs))

    def member_ids(self) -> dict[int, Int]:
        """Return nothing: a slot in inverse depth is not associated with bearings."""
        return {}

    def forget(self, step: int, landmark: int) -> None:
        """Delete a landmark."""
        self._remove(self._depths.pop(landmark))
        self.log.end(step, landmark)

    def _correct(self, step: int, ids: list[int], bearings: Float, variances: Float) -> None:
        """Correct with the bearings (m,) that pass the gate; delete landmarks that fail too often."""
        columns = np.concatenate(
            [[0, 1, 2], self._map.state.columns_of(np.concatenate([self._depths[landmark].ids for landmark in ids]))]
        )
        innovation, jacobian = linearise_depths(self._map.state.entries(columns), bearings)
        predicted = ((jacobian @ self._map.state.block(columns)) * jacobian).sum(axis=1)
        passed = innovation**2 <= self._settings.gate * (predicted + variances)
        used = passed & (predicted < VAGUE**2)
        if used.any():
            self._map.correction.update_linear(columns, jacobian[used], innovation[used], np.diag(variances[used]))
        for landmark, good in zip(ids, passed.tolist(), strict=True):
            depth = self._depths[landmark]
            depth.failures = 0 if good else depth.failures + 1
            if depth.failures >= self._settings.lost_after:
                self.forget(step, landmark)

    def _place_or_drop(self, step: int, landmark: int, points: dict[int, int]) -> None:
        """Convert a landmark with a well-known depth into a point; delete one beyond infinity."""
        if landmark not in self._depths:
            return
        depth = self._depths[landmark]
        columns = self._map.state.columns_of(depth.ids)
        state, sigma = self._map.state.entries(columns), math.sqrt(max(self._map.state.block(columns)[3, 3], 0.0))
        if state[3] < -BEYOND_INFINITY * sigma:
            self.forget(step, landmark)
        elif state[3] > 0.0 and linearity_index(state, sigma, self._map.state.robot) < self._settings.linearity:
            position, jacobian = locate_depth(state)
            new = self._ids.take(1)
            add_entries(self._map, new, NewEntries(position, columns, jacobian, np.zeros((2, 2)), [True]))
            points[landmark] = int(new[0])
            self._remove(self._depths.pop(landmark))
            self.log.end(step, landmark, 0)

    def _begin(self, step: int, landmark: int, bearing: float, variance: float) -> None:
        """Start a new landmark, anchored at the robot."""
        x, y, heading = self._map.state.robot
        jacobian = np.zeros((4, 3))
        jacobian[:3] = np.eye(3)
        own = np.diag([0.0, 0.0, variance, self._settings.sigma**2])
        ids = self._ids.take(2)
        values = np.array([x, y, wrap(heading + bearing), self._settings.mean])
        add_entries(self._map, ids, NewEntries(values, np.arange(3), jacobian, own, [True, False]))
        self._depths[landmark] = Depth(ids)
        self.log.begin(step, landmark, np.array([1.0 / self._settings.mean]))

    def _as_point(self, depth: Depth) -> tuple[Float, Float]:
        columns = self._map.state.columns_of(depth.ids)
        state = self._map.state.entries(columns)
        state[3] = max(state[3], self._settings.mean / FARTHEST)
        position, jacobian = locate_depth(state)
        return position + self._map.state.origin, jacobian @ self._map.state.block(columns) @ jacobian.T

    def _remove(self, depth: Depth) -> None:
        for each in depth.ids:
            remove_landmark(self._map, int(self._map.state.slots_of(each)))


def linearise_depths(state: Float, bearings: Float) -> tuple[Float, Float]:
    """Return innovations (m,) of bearings [rad] and their Jacobian (m, 3 + 4m); zero for landmarks at the robot.

    Args:
        state: (3 + 4m,) robot x, y, heading, then anchor x, y, phi and omega of each landmark.
        bearings: (m,) in the body frame.
    """
    count = len(bearings)
    anchor, phi, omega = state[3:].reshape(-1, 4)[:, :2], state[5::4], state[6::4]
    along = np.column_stack([np.cos(phi), np.sin(phi)])
    offset = anchor - state[:2]
    delta = omega[:, None] * offset + along
    squared = (delta**2).sum(axis=1)
    near = squared < (MIN_BEARING_DISTANCE * omega) ** 2
    gradient = np.column_stack(bearing_gradient(delta[:, 0], delta[:, 1], np.where(near, 1.0, squared)))
    jacobian = np.zeros((count, 3 + 4 * count))
    jacobian[:, :2] = -omega[:, None] * gradient
    jacobian[:, 2] = -1.0
    row, first = np.arange(count), 3 + 4 * np.arange(count)
    jacobian[row, first], jacobian[row, first + 1] = -jacobian[:, 0], -jacobian[:, 1]
    jacobian[row, first + 2] = gradient[:, 1] * along[:, 0] - gradient[:, 0] * along[:, 1]
    jacobian[row, first + 3] = (gradient * offset).sum(axis=1)
    jacobian[near] = 0.0
    innovation = wrap(bearings - (np.arctan2(delta[:, 1], delta[:, 0]) - state[2]))
    return np.where(near, 0.0, innovation), jacobian


def locate_depth(state: Float) -> tuple[Float, Float]:
    """Return the position (2,) [m] of a landmark (anchor x, y, phi, omega), omega > 0, and its Jacobian (2, 4)."""
    omega, along = state[3], np.array([np.cos(state[2]), np.sin(state[2])])
    jacobian = np.column_stack([np.eye(2), np.array([-along[1], along[0]]) / omega, -along / omega**2])
    return state[:2] + along / omega, jacobian


def linearity_index(state: Float, sigma: float, pose: Float) -> float:
    """Return 4 sigma_d / d |cos(parallax)|; a point represents the depth well if this is small.

    sigma_d = sigma / omega^2, and d is the distance of the landmark (anchor x, y, phi, omega) from the robot.
    """
    position, _ = locate_depth(state)
    offset = position - pose[:2]
    distance = max(float(np.hypot(*offset)), MIN_BEARING_DISTANCE)
    cosine = abs(offset @ (position - state[:2])) * state[3] / distance
    return float(4.0 * sigma / state[3] ** 2 / distance * cosine)
