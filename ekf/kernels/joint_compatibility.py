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
    """The first n pairs of a set, and their joint innovation; the caller stores n."""

    taken: Int  # (depths,) the pairs, in the order of the columns of U
    U: Float  # (2 depths, 2 depths) factor of the joint innovation covariance
    y: Float  # (2 depths,) whitened joint innovation


class Branch(NamedTuple):
    """The present set of pairs of the search: one observation at each depth, with or without a landmark."""

    rows: Int  # (depths,) observation of each depth
    first: Int  # (depths,) start of its range in `Pairs.by_distance`
    last: Int  # (depths,) end of this range; as a cursor it means no landmark
    cursor: Int  # (depths,) candidate to try next
    chosen: Int  # (depths,) pair, or NONE
    placed: Int  # (depths + 1,) number of pairs before each depth
    total: Float  # (depths + 1,) joint d^2 before each depth
    joint: Joint


@kernel
def search_jointly(
    cov: Float, covs: Float, pairs: Pairs, gate: float, quantiles: Float, node_limit: int
) -> tuple[Int, int]:
    """Find the joint association of m observations by depth-first branch and bound.

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
    branch = _root(pairs, gate, len(best))
    depths, joint = len(branch.rows), branch.joint
    most, least, nodes, depth = 0, 0.0, 0, 0
    while depth >= 0 and depths:
        n, total = branch.placed[depth], branch.total[depth]
        promising = n + depths - depth > most or (n + depths - depth == most and total < least)
        if depth == depths or not promising or branch.cursor[depth] > branch.last[depth]:
            depth -= 1
            continue
        place = branch.cursor[depth]
        branch.cursor[depth] += 1
        if place == branch.last[depth]:  # all landmarks have been tried: the observation stays without one
            _descend(branch, depth, NONE, total)
        else:
            c = int(pairs.by_distance[place])
            if _is_taken(pairs, joint.taken, n, c):
                continue
            if nodes >= node_limit:
                break
            nodes += 1
            distance = _extend(cov, covs, pairs, joint, n, c) + total
            if not distance <= quantiles[n + 1]:
                continue
            _descend(branch, depth, c, distance)
            if n + 1 > most or (n + 1 == most and distance < least):
                most, least = n + 1, distance
                _copy_slots(branch, depth, pairs, best)
        depth += 1
    return best, nodes


@inner
def _root(pairs: Pairs, gate: float, observations: int) -> Branch:
    """Return the empty set."""
    rows, first, last = _rows_to_place(pairs, gate, observations)
    depths = len(rows)
    placed, total = np.zeros(depths + 1, dtype=np.int64), np.zeros(depths + 1)
    return Branch(rows, first, last, first.copy(), np.full(depths, NONE), placed, total, _empty(depths))


@inner
def _empty(most: int) -> Joint:
    """Allocate arrays for `most` pairs."""
    return Joint(np.full(most, NONE), np.zeros((2 * most, 2 * most)), np.zeros(2 * most))


@inner
def _descend(branch: Branch, depth: int, c: int, total: float) -> None:
    """Choose pair c, or NONE, at this depth, and start the next depth with the nearest landmark of its observation."""
    n = branch.placed[depth]
    branch.chosen[depth] = c
    if c != NONE:
        branch.joint.taken[n] = c
        n += 1
    branch.placed[depth + 1], branch.total[depth + 1] = n, total
    if depth + 1 < len(branch.rows):
        branch.cursor[depth + 1] = branch.first[depth + 1]


@inner
def _copy_slots(branch: Branch, depth: int, pairs: Pairs, best: Int) -> None:
    """Copy the slots of the set, from depth 0 to this depth, to `best`."""
    best[:] = NONE
    for d in range(depth + 1):
        if branch.chosen[d] != NONE:
            best[branch.rows[d]] = pairs.slot[branch.chosen[d]]


@inner
def _rows_to_place(pairs: Pairs, gate: float, observations: int) -> tuple[Int, Int, Int]:
    """Return observations with pairs inside the gate, fewest first, and the range of `by_distance` of each."""
    first, last = np.zeros(observations, dtype=np.int64), np.zeros(observations, dtype=np.int64)
    for place in range(len(pairs.slot)):
        i = pairs.observation[place]
        if place == 0 or pairs.observation[place - 1] != i:
            first[i] = last[i] = place
        if pairs.distance[pairs.by_distance[place]] <= gate:
            last[i] += 1  # the nearest pairs come first
    rows, count = np.empty(observations, dtype=np.int64), 0
    for i in range(observations):
        if last[i] == first[i]:
            continue
        place = count
        while place > 0 and last[rows[place - 1]] - first[rows[place - 1]] > last[i] - first[i]:
            rows[place] = rows[place - 1]
            place -= 1
        rows[place] = i
        count += 1
    rows = rows[:count]
    return rows, first[rows], last[rows]


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
