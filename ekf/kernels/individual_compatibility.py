"""Individual compatibility: the candidate landmarks of each observation of a scan, and duplicate landmarks, compiled.

An observation is individually compatible with a landmark if its squared Mahalanobis distance
d^2 = v' S^-1 v is at most the gate. A lower bound of d^2 that needs only the positions and their variances excludes
distant landmarks before S is computed. It never excludes a landmark that passes the gate.

Source: Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test",
IEEE Transactions on Robotics and Automation 17(6), 2001.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.belief import ROBOT, Belief
from slamgauge.ekf.kernels.covariance import own_covariance, squared_distance
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.formula_kernels import HAS_RANGE, PLACES_LANDMARKS
from slamgauge.jit import inner, kernel


class Pairs(NamedTuple):
    """Pairs of an observation and a landmark, ordered by observation, then by slot."""

    observation: Int  # (c,) index in the scan
    slot: Int  # (c,) slot in the state
    innovation: Float  # (2c,)
    jacobian: Float  # (2c, 5) columns as in `kernels.linearise`
    distance: Float  # (c,) d^2
    by_distance: Int  # (c,) the pairs of each observation, nearest first


class Reach(NamedTuple):
    """Terms of the lower bound of d^2; see `is_within_reach`."""

    measured: float  # measured distance [m]; negative for a bearing-only sensor, which excludes no landmark
    noise: float  # upper bound of the variance of the measured distance [m^2]
    robot: float  # standard deviation of the robot's position [m]
    heading: float  # standard deviation of the heading [rad], 0 if the measurement does not depend on it


@kernel
def find_compatible(sensor: int, belief: Belief, values: Float, covs: Float, gate: float) -> Pairs:
    """Return all pairs of an observation (m, 2), covariance (m, 2, 2), and a landmark with d^2 <= gate."""
    most, count = len(values) * ((belief.size - ROBOT) // 2), 0
    observation, slot, by_distance = np.empty((3, most), dtype=np.int64)
    innovation, jacobian, distances = np.empty(2 * most), np.empty((2 * most, 5)), np.empty(most)
    for i in range(len(values)):
        reach, first = reach_of(sensor, values[i], covs[i], belief.cov), count
        for landmark in range(ROBOT, belief.size, 2):
            if not is_within_reach(reach, belief, landmark, _lever(reach, belief, landmark), gate):
                continue
            slot[count] = (landmark - ROBOT) // 2
            v, h = innovation[2 * count : 2 * count + 2], jacobian[2 * count : 2 * count + 2]
            linearise(sensor, belief, slot[count : count + 1], values[i : i + 1], v, h)
            s00, s01, s11 = own_covariance(belief.cov, h, landmark, covs[i])
            distance = squared_distance(v[0], v[1], s00, s01, s11)
            if distance <= gate:
                observation[count], distances[count] = i, distance
                _insert(by_distance, distances, first, count)
                count += 1
    rows = 2 * count
    return Pairs(
        observation[:count], slot[:count], innovation[:rows], jacobian[:rows], distances[:count], by_distance[:count]
    )


@inner
def _lever(reach: Reach, belief: Belief, landmark: int) -> float:
    """Return the distance [m] at which an error of the heading moves the landmark; 0 if it does not matter."""
    if reach.heading == 0.0:
        return 0.0
    dx, dy = belief.point[landmark] - belief.point[0], belief.point[landmark + 1] - belief.point[1]
    return math.sqrt(dx * dx + dy * dy)


@inner
def _insert(by_distance: Int, distances: Float, first: int, pair: int) -> None:
    """Insert a pair into the sorted pairs `first`..`pair` of its observation."""
    place = pair
    while place > first and distances[by_distance[place - 1]] > distances[pair]:
        by_distance[place] = by_distance[place - 1]
        place -= 1
    by_distance[place] = pair


@inner
def reach_of(sensor: int, z: Float, R: Float, cov: Float) -> Reach:
    """Return the terms for an observation z (2,) with covariance R (2, 2), and the covariance `cov` of the belief."""
    robot = math.sqrt(max(cov[0, 0] + cov[1, 1], 0.0))
    if not PLACES_LANDMARKS[sensor]:
        return Reach(-1.0, 0.0, robot, 0.0)
    if HAS_RANGE[sensor]:
        return Reach(z[0], R[0, 0], robot, 0.0)
    heading = math.sqrt(max(cov[2, 2], 0.0))  # a position in the body frame depends on the heading
    return Reach(math.sqrt(z[0] ** 2 + z[1] ** 2), R[0, 0] + R[1, 1], robot, heading)


@inner
def is_within_reach(reach: Reach, belief: Belief, landmark: int, lever: float, gate: float) -> bool:
    """Return whether the landmark at entry `landmark` may have d^2 <= gate.

    Let s be the sum of the standard deviations of robot, landmark, and heading times `lever` [m]. The variance of the
    expected distance is at most s^2, and so d^2 >= (measured - expected distance)^2 / (s^2 + noise).
    """
    if reach.measured < 0.0:
        return True
    state, cov = belief.state, belief.cov
    expected = math.sqrt((state[landmark] - state[0]) ** 2 + (state[landmark + 1] - state[1]) ** 2)
    own = math.sqrt(max(cov[landmark, landmark] + cov[landmark + 1, landmark + 1], 0.0))
    spread = reach.robot + own + lever * reach.heading
    return (reach.measured - expected) ** 2 <= gate * (spread * spread + reach.noise)


@kernel
def find_duplicates(belief: Belief, slots: Int, apart: Marks, gate: float) -> Int:
    """Return pairs (p, 2) of a landmark in `slots` (s,) and another landmark that may be a duplicate of it.

    Their difference d, with covariance C, passes the test d' C^-1 d <= gate. Pairs marked in `apart` (s, L) are
    different landmarks for certain and are skipped. No eigenvalue of C exceeds the squared sum of both standard
    deviations; this bound excludes most pairs before C is computed.
    """
    state, cov = belief.state, belief.cov
    landmarks = (belief.size - 3) // 2
    found, count = np.empty((len(slots) * landmarks, 2), np.int64), 0
    for i, a in enumerate(slots):
        la = 3 + 2 * a
        own = math.sqrt(cov[la, la] + cov[la + 1, la + 1])
        for b in range(landmarks):
            lb = 3 + 2 * b
            dx, dy = state[la] - state[lb], state[la + 1] - state[lb + 1]
            spread = own + math.sqrt(cov[lb, lb] + cov[lb + 1, lb + 1])
            if apart[i, b] or a == b or dx * dx + dy * dy > gate * spread * spread:
                continue
            low, high = min(la, lb), max(la, lb)
            xx = cov[la, la] + cov[lb, lb] - 2.0 * cov[low, high]
            yy = cov[la + 1, la + 1] + cov[lb + 1, lb + 1] - 2.0 * cov[low + 1, high + 1]
            xy = cov[la, la + 1] + cov[lb, lb + 1] - cov[low, high + 1] - cov[low + 1, high]
            determinant = xx * yy - xy * xy
            if determinant > 0.0 and dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx <= gate * determinant:
                found[count, 0], found[count, 1] = a, b
                count += 1
    return found[:count]
