"""The joint compatibility test by branch and bound, compiled.

A set of pairs contains no landmark twice. The search adds the observations one after the other, those with the fewest
candidates first. The set must stay jointly compatible: its joint d^2 is at most a chi-square quantile for its
dimension. Among all sets that can be built in this way, the search finds one with the most pairs, and among these one
with the smallest joint d^2.

Source: Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test",
IEEE Transactions on Robotics and Automation 17(6), 2001.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE, ROBOT
from slamgauge.ekf.kernels.covariance import cross_covariance, own_covariance
from slamgauge.ekf.kernels.individual_compatibility import Pairs
from slamgauge.jit import inner, kernel


class Joint(NamedTuple):
    """The present set of pairs and their joint innovation; the caller stores their number n."""

    taken: Int  # (depths,) the pairs, in the order of the columns of U
    U: Float  # (2 depths, 2 depths) factor of the joint innovation covariance
    y: Float  # (2 depths,) whitened joint innovation


@kernel
def search_jointly(
    cov: Float, covs: Float, pairs: Pairs, gate: float, quantiles: Float, node_limit: int
) -> tuple[Int, int]:
    """Find the joint association of m observations by depth-first branch and bound.

    At each depth one observation is paired with a landmark, or stays without one.

    Args:
        cov: the covariance P.
        covs: (m, 2, 2) of the observations.
        pairs: result of `find_compatible`.
        gate: pairs with a larger d^2 are ignored.
        quantiles: (m + 1,) largest joint d^2 for 0, 1, ... pairs.
        node_limit: largest number of pairs to try; at the limit the search returns the best set so far. The first
            set contains the nearest neighbours that are jointly compatible, so a result always exists.

    Returns:
        Slots (m,), NONE for an observation without a landmark, and the number of pairs that were tried.
    """
    best = np.full(len(covs), NONE)
    first, last = _candidates(pairs, gate, len(covs))
    depths = len(first)
    joint = Joint(np.full(depths, NONE), np.zeros((2 * depths, 2 * depths)), np.zeros(2 * depths))
    cursor, placed, total = first.copy(), np.zeros(depths + 1, dtype=np.int64), np.zeros(depths + 1)
    most, least, nodes, depth = 0, 0.0, 0, 0
    while depth >= 0:
        n, distance, left = placed[depth], total[depth], depths - depth
        promising = n + left > most or (n + left == most and distance < least)
        if left == 0 or not promising or cursor[depth] > last[depth]:
            depth -= 1
            continue
        place = cursor[depth]
        cursor[depth] += 1
        if place < last[depth]:  # otherwise all landmarks have been tried: the observation stays without one
            c = int(pairs.by_distance[place])
            if _is_taken(pairs, joint.taken, n, c):
                continue
            if nodes >= node_limit:
                break
            nodes += 1
            distance += _extend(cov, covs, pairs, joint, n, c)
            if not distance <= quantiles[n + 1]:
                continue
            joint.taken[n] = c
            n += 1
            if n > most or (n == most and distance < least):
                most, least = n, distance
                best[:] = NONE
                for k in range(n):
                    best[pairs.observation[joint.taken[k]]] = pairs.slot[joint.taken[k]]
        depth += 1
        placed[depth], total[depth] = n, distance
        if depth < depths:
            cursor[depth] = first[depth]
    return best, nodes


@inner
def _candidates(pairs: Pairs, gate: float, observations: int) -> tuple[Int, Int]:
    """Return the range of `by_distance` inside the gate of each observation that has one, shortest first."""
    first, last = np.zeros(observations, dtype=np.int64), np.zeros(observations, dtype=np.int64)
    for place in range(len(pairs.slot)):
        i = pairs.observation[place]
        if place == 0 or pairs.observation[place - 1] != i:
            first[i] = last[i] = place
        if pairs.distance[pairs.by_distance[place]] <= gate:
            last[i] += 1  # the nearest pairs come first
    count = 0
    for i in range(observations):
        begin, end, place = first[i], last[i], count
        if begin == end:
            continue
        while place > 0 and last[place - 1] - first[place - 1] > end - begin:
            first[place], last[place] = first[place - 1], last[place - 1]
            place -= 1
        first[place], last[place] = begin, end
        count += 1
    return first[:count], last[:count]


@inner
def _is_taken(pairs: Pairs, taken: Int, n: int, c: int) -> bool:
    """Return whether one of the first n pairs has the landmark of pair c."""
    for k in range(n):  # noqa: SIM110 numba compiles no generator expressions
        if pairs.slot[taken[k]] == pairs.slot[c]:
            return True
    return False


@inner
def _extend(cov: Float, covs: Float, pairs: Pairs, joint: Joint, n: int, c: int) -> float:
    """Add pair c to the first n pairs: two columns of U and two rows of y; return the increase of the joint d^2."""
    taken, U, y = joint
    k, column, h = 2 * n, ROBOT + 2 * pairs.slot[c], pairs.jacobian[2 * c : 2 * c + 2]
    for b in range(n):
        other = taken[b]
        h_other = pairs.jacobian[2 * other : 2 * other + 2]
        block = cross_covariance(cov, h_other, ROBOT + 2 * pairs.slot[other], h, column)
        U[2 * b, k], U[2 * b, k + 1], U[2 * b + 1, k], U[2 * b + 1, k + 1] = block
    U[k, k], U[k, k + 1], U[k + 1, k + 1] = own_covariance(cov, h, column, covs[pairs.observation[c]])
    added = 0.0
    for column in range(k, k + 2):
        value = pairs.innovation[2 * c + column - k]
        for row in range(column):
            for above in range(row):
                U[row, column] -= U[above, row] * U[above, column]
            U[row, column] /= U[row, row]
            value -= U[row, column] * y[row]
        for above in range(column):
            U[column, column] -= U[above, column] ** 2
        if not U[column, column] > 0.0:
            return math.inf
        U[column, column] = math.sqrt(U[column, column])
        y[column] = value / U[column, column]
        added += y[column] ** 2
    return added
