"""Individual compatibility: the candidate landmarks of each observation of a scan, compiled.

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

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.covariance import noise, squared_distance
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.jit import inner, kernel
from slamgauge.sensor_kernels import HAS_RANGE, PLACES_LANDMARKS

NONE = -1  # no landmark


class Pairs(NamedTuple):
    """Pairs of an observation and a landmark, ordered by observation, then by slot."""

    observation: Int  # (c,) index in the scan
    slot: Int  # (c,) slot in the state
    value: Float  # (c, 2) the observation; used only inside `find_compatible`
    innovation: Float  # (2c,)
    jacobian: Float  # (2c, 5) columns as in `kernels.linearise`
    distance: Float  # (c,) d^2
    by_distance: Int  # (c,) the pairs of each observation, nearest first


def allocate_pairs(capacity: int) -> Pairs:
    """Allocate arrays for `capacity` pairs."""
    return Pairs(
        observation=np.zeros(capacity, dtype=np.int64),
        slot=np.zeros(capacity, dtype=np.int64),
        value=np.zeros((capacity, 2)),
        innovation=np.zeros(2 * capacity),
        jacobian=np.zeros((2 * capacity, 5)),
        distance=np.zeros(capacity),
        by_distance=np.zeros(capacity, dtype=np.int64),
    )


@kernel
def find_compatible(sensor: int, belief: Belief, values: Float, covs: Float, gate: float, pairs: Pairs) -> int:
    """Fill `pairs` with all pairs of an observation (m, 2), covariance (m, 2, 2), and a landmark with d^2 <= gate.

    Returns their number, or -n if `pairs` is too small and needs a capacity of n.
    """
    candidates = _find_near(sensor, belief, values, covs, gate, pairs)
    if candidates > len(pairs.slot):
        return -candidates
    linearise(sensor, belief, pairs.slot[:candidates], pairs.value, pairs.innovation, pairs.jacobian)
    S = np.empty((2, 2))
    count = 0
    for c in range(candidates):
        pair_covariance(belief.cov, pairs, c, c, S)
        add_noise(covs[pairs.observation[c]], pairs.jacobian[2 * c + 1], S)
        v0, v1 = pairs.innovation[2 * c], pairs.innovation[2 * c + 1]
        distance = squared_distance(v0, v1, S[0, 0], S[0, 1], S[1, 1])
        if distance <= gate:
            pairs.observation[count] = pairs.observation[c]
            pairs.slot[count] = pairs.slot[c]
            for row in range(2):
                pairs.innovation[2 * count + row] = pairs.innovation[2 * c + row]
                for column in range(pairs.jacobian.shape[1]):
                    pairs.jacobian[2 * count + row, column] = pairs.jacobian[2 * c + row, column]
            pairs.distance[count] = distance
            count += 1
    _sort_by_distance(pairs, count)
    return count


@inner
def _find_near(sensor: int, belief: Belief, values: Float, covs: Float, gate: float, pairs: Pairs) -> int:
    """Fill `pairs` with all pairs that the lower bound of d^2 does not exclude; return their number."""
    point = belief.point
    candidates = 0
    for i in range(len(values)):
        reach = reach_of(sensor, values[i], covs[i], belief.cov)
        for landmark in range(3, belief.size, 2):
            lever = 0.0
            if reach.heading > 0.0:
                lever = math.sqrt((point[landmark] - point[0]) ** 2 + (point[landmark + 1] - point[1]) ** 2)
            if is_within_reach(reach, belief, landmark, lever, gate):
                if candidates < len(pairs.slot):
                    pairs.observation[candidates] = i
                    pairs.slot[candidates] = (landmark - 3) // 2
                    pairs.value[candidates] = values[i]
                candidates += 1
    return candidates


class Reach(NamedTuple):
    """Terms of the lower bound of d^2; see `is_within_reach`."""

    measured: float  # measured distance [m]; negative for a bearing-only sensor, which excludes no landmark
    noise: float  # upper bound of the variance of the measured distance [m^2]
    robot: float  # standard deviation of the robot's position [m]
    heading: float  # standard deviation of the heading [rad], 0 if the measurement does not depend on it


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


def first_pairs(pairs: Pairs, count: int) -> Pairs:
    """Return the first `count` pairs, as views."""
    double = {"innovation", "jacobian"}  # two rows for each pair
    return Pairs(*(each[: 2 * count if name in double else count] for name, each in pairs._asdict().items()))


@inner
def _sort_by_distance(pairs: Pairs, count: int) -> None:
    """Fill `by_distance` for the first `count` pairs."""
    first = 0
    while first < count:
        last = first
        while last < count and pairs.observation[last] == pairs.observation[first]:
            last += 1
        order = np.argsort(pairs.distance[first:last])
        for i in range(last - first):
            pairs.by_distance[first + i] = first + order[i]
        first = last


@inner
def pair_covariance(cov: Float, pairs: Pairs, a: int, b: int, out: Float) -> None:
    """Compute `out` (2, 2) = H_a P H_b' for the pairs a and b, from the upper triangle of P."""
    la, lb = 3 + 2 * pairs.slot[a], 3 + 2 * pairs.slot[b]
    for i in range(2):
        ha = pairs.jacobian[2 * a + i]
        # `across` is an entry of H_a P, in the columns that H_b multiplies
        for j in range(2):
            hb = pairs.jacobian[2 * b + j]
            total = 0.0
            for k in range(3):
                across = ha[0] * cov[0, k] + ha[1] * cov[1, k] + ha[2] * cov[2, k]
                across += ha[3] * cov[k, la] + ha[4] * cov[k, la + 1]
                total += across * hb[k]
            for k in range(2):
                column = lb + k
                across = ha[0] * cov[0, column] + ha[1] * cov[1, column] + ha[2] * cov[2, column]
                across += ha[3] * cov[min(la, column), max(la, column)]
                across += ha[4] * cov[min(la + 1, column), max(la + 1, column)]
                total += across * hb[3 + k]
            out[i, j] = total


@inner
def add_noise(R: Float, second_row: Float, S: Float) -> None:
    """S <- S + R for one observation (see `covariance.noise`)."""
    r00, r01, r11 = noise(R, second_row)
    S[0, 0] += r00
    S[0, 1] += r01
    S[1, 0] += r01
    S[1, 1] += r11
