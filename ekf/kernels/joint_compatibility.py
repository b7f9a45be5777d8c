"""The joint compatibility test by branch and bound, and which of its associations are ambiguous.

Sets of pairs, no landmark twice, grow observation by observation, those with the fewest candidates first, as long as
they are jointly compatible: joint d^2 below a chi-square quantile of its dimension. Of all sets that can grow like
this, the search finds one with the most pairs, and among these the smallest joint d^2.

Source: Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test",
IEEE Transactions on Robotics and Automation 17(6), 2001.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.individual_compatibility import NONE, Pairs, add_noise, pair_covariance
from slamgauge.jit import kernel


class Branch(NamedTuple):
    """The set of pairs that the search is at: one observation at each depth, with a landmark or without."""

    rows: Int  # (depths,) observation of each depth
    first: Int  # (depths,) its stretch in `Pairs.by_distance`; `last` stands for no landmark
    last: Int  # (depths,)
    cursor: Int  # (depths,) what is to be tried next
    chosen: Int  # (depths,) pair, or NONE
    placed: Int  # (depths + 1,) pairs before each depth
    total: Float  # (depths + 1,) joint d^2 before each depth
    taken: Int  # (depths,) the pairs, in the order of the columns of U
    U: Float  # (2 depths, 2 depths) factor of the joint innovation covariance
    y: Float  # (2 depths,) whitened joint innovation


@kernel
def search_jointly(
    cov: Float, covs: Float, pairs: Pairs, count: int, gate: float, quantiles: Float, node_limit: int, best: Int
) -> int:
    """Joint compatibility by depth-first branch and bound; fills `best` (m,) with slots, or NONE.

    Args:
        cov: the covariance P.
        covs: (m, 2, 2) of the observations.
        pairs: what `find_compatible` has left there.
        count: how many of them.
        gate: pairs with a larger d^2 of their own are left out.
        quantiles: (m + 1,) largest joint d^2 for 0, 1, ... pairs.
        node_limit: pairs to try at most; the best set so far is then the result. The first one found is
            that of the nearest neighbours that are jointly compatible, so there always is one.
        best: the result.

    Returns:
        How many pairs were tried.
    """
    best[:] = NONE
    branch = _root(pairs, count, gate, len(best))
    depths = len(branch.rows)
    most, least, nodes, depth = 0, 0.0, 0, 0
    while depth >= 0 and depths:
        n, total = branch.placed[depth], branch.total[depth]
        promising = n + depths - depth > most or (n + depths - depth == most and total < least)
        if depth == depths or not promising or branch.cursor[depth] > branch.last[depth]:
            depth -= 1
            continue
        place = branch.cursor[depth]
        branch.cursor[depth] += 1
        if place == branch.last[depth]:  # every landmark has been tried: none
            _descend(branch, depth, NONE, total)
        else:
            c = int(pairs.by_distance[place])
            if _is_taken(pairs, branch.taken, n, c):
                continue
            if nodes >= node_limit:
                break
            nodes += 1
            distance = _extend(cov, covs, pairs, branch.taken, n, c, branch.U, branch.y) + total
            if not distance <= quantiles[n + 1]:
                continue
            _descend(branch, depth, c, distance)
            if n + 1 > most or (n + 1 == most and distance < least):
                most, least = n + 1, distance
                _note(branch, depth, pairs, best)
        depth += 1
    return nodes


@kernel
def _root(pairs: Pairs, count: int, gate: float, observations: int) -> Branch:
    """The empty set."""
    rows, first, last = _rows_to_place(pairs, count, gate, observations)
    depths = len(rows)
    chosen, taken = np.full(depths, NONE), np.full(depths, NONE)
    placed, total = np.zeros(depths + 1, dtype=np.int64), np.zeros(depths + 1)
    U, y = np.zeros((2 * depths, 2 * depths)), np.zeros(2 * depths)
    cursor = first.copy()
    return Branch(rows, first, last, cursor, chosen, placed, total, taken, U, y)


@kernel
def _descend(branch: Branch, depth: int, c: int, total: float) -> None:
    """Choose pair c, or NONE, at this depth; the next one starts with its nearest landmark."""
    n = branch.placed[depth]
    branch.chosen[depth] = c
    if c != NONE:
        branch.taken[n] = c
        n += 1
    branch.placed[depth + 1], branch.total[depth + 1] = n, total
    if depth + 1 < len(branch.rows):
        branch.cursor[depth + 1] = branch.first[depth + 1]


@kernel
def _note(branch: Branch, depth: int, pairs: Pairs, best: Int) -> None:
    """Note the slots of the set down to this depth."""
    best[:] = NONE
    for d in range(depth + 1):
        if branch.chosen[d] != NONE:
            best[branch.rows[d]] = pairs.slot[branch.chosen[d]]


@kernel
def _rows_to_place(pairs: Pairs, count: int, gate: float, observations: int) -> tuple[Int, Int, Int]:
    """Observations with pairs inside the gate, fewest first, and the stretch of `by_distance` of each."""
    first, last = np.zeros(observations, dtype=np.int64), np.zeros(observations, dtype=np.int64)
    for place in range(count):
        i = pairs.observation[place]
        if place == 0 or pairs.observation[place - 1] != i:
            first[i] = last[i] = place
        if pairs.distance[pairs.by_distance[place]] <= gate:
            last[i] += 1  # the nearest come first
    rows = np.flatnonzero(last - first > 0)
    rows = rows[np.argsort((last - first)[rows], kind="mergesort")]
    return rows, first[rows], last[rows]


@kernel
def _is_taken(pairs: Pairs, taken: Int, n: int, c: int) -> bool:
    """Whether one of the first n pairs has the landmark of pair c."""
    for k in range(n):  # noqa: SIM110 numba compiles no generator expressions
        if pairs.owner[taken[k]] == pairs.owner[c]:
            return True
    return False


@kernel
def _extend(cov: Float, covs: Float, pairs: Pairs, taken: Int, n: int, c: int, U: Float, y: Float) -> float:
    """What pair c adds to the joint d^2 of the first n pairs: two more columns of S = U'U, two more rows of y."""
    S = np.empty((2, 2))
    k = 2 * n
    for b in range(n):
        pair_covariance(cov, pairs, taken[b], c, S)
        U[2 * b : 2 * b + 2, k : k + 2] = S
    pair_covariance(cov, pairs, c, c, S)
    add_noise(covs[pairs.observation[c]], pairs.jacobian[2 * c + 1], S)
    U[k : k + 2, k : k + 2] = S
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


@kernel
def mark_ambiguous(
    cov: Float,
    covs: Float,
    pairs: Pairs,
    count: int,
    gate: float,
    margin: float,
    node_limit: int,
    best: Int,
    ambiguous: Marks,
) -> int:
    """Mark the observations whose landmarks in `best` another association explains nearly as well.

    Tried are those that give one observation a landmark that is free, or let two of them change places; nearly
    is a joint d^2 within `margin`: such an alternative is at least exp(-margin / 2) times as likely. Each tries as many
    pairs as `best` has; what would come after `node_limit` of them is not looked at.

    Returns:
        How many pairs were tried.
    """
    observations = len(best)
    chosen = np.full(observations, NONE)  # pair of each observation
    holder = np.full(count, NONE)  # of each pair's landmark: the pair that has it in `best`
    for c in range(count):
        if best[pairs.observation[c]] == pairs.slot[c]:
            chosen[pairs.observation[c]] = c
    for c in range(count):
        for i in range(observations):
            if chosen[i] != NONE and pairs.owner[chosen[i]] == pairs.owner[c]:
                holder[c] = chosen[i]
    taken = chosen[chosen != NONE]
    least, nodes = -1.0, 0
    for c in range(count):
        i = pairs.observation[c]
        if nodes + len(taken) > node_limit:
            break
        if ambiguous[i] or chosen[i] == NONE or chosen[i] == c or pairs.distance[c] > gate:
            continue
        alternative = np.where(taken == chosen[i], c, taken)
        other = holder[c]
        if other != NONE:
            swapped = _crossed(pairs, count, int(other), int(chosen[i]))
            if swapped == NONE or pairs.distance[swapped] > gate:
                continue
            alternative = np.where(taken == other, swapped, alternative)
        if least < 0.0:
            least = _joint_distance(cov, covs, pairs, taken)
        nodes += len(taken)
        if _joint_distance(cov, covs, pairs, alternative) <= least + margin:
            ambiguous[i] = True
    return nodes


@kernel
def _crossed(pairs: Pairs, count: int, a: int, b: int) -> int:
    """The pair of a's observation and b's landmark, NONE if they are not compatible."""
    for c in range(count):
        if pairs.observation[c] == pairs.observation[a] and pairs.owner[c] == pairs.owner[b]:
            return c
    return NONE


@kernel
def _joint_distance(cov: Float, covs: Float, pairs: Pairs, taken: Int) -> float:
    """Joint d^2 of the pairs `taken`."""
    rows = 2 * len(taken)
    U, y = np.zeros((rows, rows)), np.zeros(rows)
    total = 0.0
    for n in range(len(taken)):
        total += _extend(cov, covs, pairs, taken, n, taken[n], U, y)
    return total
