"""Which landmarks the observations of a scan may have come from, one by one and jointly.

An observation is individually compatible with a landmark when its squared Mahalanobis distance
d^2 = v' S^-1 v is below a gate. Before S is formed, a bound on d^2 that needs four numbers of a landmark
sets the far ones aside; it never sets aside one that the gate would let in.

`search_jointly` is the joint compatibility test by branch and bound. Sets of pairs, no landmark twice, grow
observation by observation, those with the fewest candidates first, as long as they are jointly compatible: joint
d^2 below a chi-square quantile of its dimension. Of all that can grow so it finds one with the most pairs, and among
these the smallest joint d^2.

Source: Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test",
IEEE Transactions on Robotics and Automation 17(6), 2001.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ekf.compiled import kernel
from ekf.kernels import linearise, squared_distance
from ekf.models import BEARING, POSITION
from ekf.workspace import Marks
from slam2d import Float, Int

NONE = -1  # no landmark


class Pairs(NamedTuple):
    """Pairs of an observation and a landmark, ordered by observation, then by slot."""

    observation: Int  # (c,) index in the scan
    slot: Int  # (c,) where the landmark is in the state
    owner: Int  # (c,) the landmark: its slot, or whatever several slots of one landmark have in common
    value: Float  # (c, 2) the observation itself, while pairs are being found
    innovation: Float  # (2c,)
    jacobian: Float  # (2c, 5) columns as in `kernels.linearise`
    distance: Float  # (c,) d^2
    by_distance: Int  # (c,) the pairs of each observation, nearest first


def allocate_pairs(capacity: int) -> Pairs:
    """Room for that many pairs."""
    return Pairs(
        observation=np.zeros(capacity, dtype=np.int64),
        slot=np.zeros(capacity, dtype=np.int64),
        owner=np.zeros(capacity, dtype=np.int64),
        value=np.zeros((capacity, 2)),
        innovation=np.zeros(2 * capacity),
        jacobian=np.zeros((2 * capacity, 5)),
        distance=np.zeros(capacity),
        by_distance=np.zeros(capacity, dtype=np.int64),
    )


@kernel
def find_compatible(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    size: int,
    values: Float,
    covs: Float,
    gate: float,
    pairs: Pairs,
) -> int:
    """Every pair of the observations (m, 2) and a landmark with d^2 <= gate.

    Returns how many there are, or -n when `pairs` must have room for n to find out.
    """
    candidates = _find_near(sensor, state, point, cov, size, values, covs, gate, pairs)
    if candidates > len(pairs.slot):
        return -candidates
    linearise(sensor, state, point, pairs.slot[:candidates], pairs.value, pairs.innovation, pairs.jacobian)
    S = np.empty((2, 2))
    count = 0
    for c in range(candidates):
        pair_covariance(cov, pairs, c, c, S)
        add_noise(covs[pairs.observation[c]], pairs.jacobian[2 * c + 1], S)
        v0, v1 = pairs.innovation[2 * c], pairs.innovation[2 * c + 1]
        distance = squared_distance(v0, v1, S[0, 0], S[0, 1], S[1, 1])
        if distance <= gate:
            pairs.observation[count] = pairs.observation[c]
            pairs.slot[count] = pairs.owner[count] = pairs.slot[c]
            pairs.innovation[2 * count : 2 * count + 2] = pairs.innovation[2 * c : 2 * c + 2]
            pairs.jacobian[2 * count : 2 * count + 2] = pairs.jacobian[2 * c : 2 * c + 2]
            pairs.distance[count] = distance
            count += 1
    _sort_by_distance(pairs, count)
    return count


@kernel
def _find_near(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    size: int,
    values: Float,
    covs: Float,
    gate: float,
    pairs: Pairs,
) -> int:
    """Pairs whose measured and expected distances agree as well as d^2 <= gate requires; returns how many.

    With s the standard deviations of robot and landmark added up, no component of H P H' exceeds s^2, and so
    d^2 >= (measured - expected distance)^2 / (s^2 + tr R). Bearings alone set nothing aside.
    """
    robot = math.sqrt(max(cov[0, 0] + cov[1, 1], 0.0))
    heading = math.sqrt(max(cov[2, 2], 0.0)) if sensor == POSITION else 0.0  # turns do not change a range
    candidates = 0
    for i in range(len(values)):
        measured = values[i, 0]
        noise = covs[i, 0, 0]
        if sensor == POSITION:
            measured = math.sqrt(values[i, 0] ** 2 + values[i, 1] ** 2)
            noise += covs[i, 1, 1]
        for landmark in range(3, size, 2):
            expected = math.sqrt((state[landmark] - state[0]) ** 2 + (state[landmark + 1] - state[1]) ** 2)
            lever = 0.0
            if heading > 0.0:
                lever = math.sqrt((point[landmark] - point[0]) ** 2 + (point[landmark + 1] - point[1]) ** 2)
            own = math.sqrt(max(cov[landmark, landmark] + cov[landmark + 1, landmark + 1], 0.0))
            spread = robot + own + lever * heading
            if sensor == BEARING or (measured - expected) ** 2 <= gate * (spread * spread + noise):
                if candidates < len(pairs.slot):
                    pairs.observation[candidates] = i
                    pairs.slot[candidates] = (landmark - 3) // 2
                    pairs.value[candidates] = values[i]
                candidates += 1
    return candidates


@kernel
def _sort_by_distance(pairs: Pairs, count: int) -> None:
    """Fill `by_distance` for the first `count` pairs."""
    first = 0
    while first < count:
        last = first
        while last < count and pairs.observation[last] == pairs.observation[first]:
            last += 1
        pairs.by_distance[first:last] = first + np.argsort(pairs.distance[first:last])
        first = last


@kernel
def pair_covariance(cov: Float, pairs: Pairs, a: int, b: int, out: Float) -> None:
    """Out (2, 2) = H_a P H_b', from the upper triangle of P."""
    la, lb = 3 + 2 * pairs.slot[a], 3 + 2 * pairs.slot[b]
    for i in range(2):
        ha = pairs.jacobian[2 * a + i]
        # H_a P, in b's columns
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


@kernel
def add_noise(R: Float, bearing_row: Float, S: Float) -> None:
    """S <- S + R; a bearing row without information keeps its own variance alone."""
    S[0, 0] += R[0, 0]
    S[1, 1] += R[1, 1]
    if bearing_row[3] != 0.0 or bearing_row[4] != 0.0:
        S[0, 1] += R[0, 1]
        S[1, 0] += R[0, 1]


@kernel
def search_jointly(
    cov: Float,
    covs: Float,
    pairs: Pairs,
    count: int,
    gate: float,
    quantiles: Float,
    node_limit: int,
    best: Int,
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
    rows, first, last = _rows_to_place(pairs, count, gate, len(best))
    depth_of = len(rows)
    chosen = np.full(depth_of + 1, NONE)  # place in `by_distance` at each depth; `last` means no landmark
    cursor = np.zeros(depth_of + 1, dtype=np.int64)
    placed = np.zeros(depth_of + 1, dtype=np.int64)  # pairs before each depth
    total = np.zeros(depth_of + 1)  # joint d^2 before each depth
    taken = np.full(depth_of + 1, NONE)  # the pairs, in the order of U's columns
    U, y = np.zeros((2 * depth_of, 2 * depth_of)), np.zeros(2 * depth_of)
    most, least, nodes = 0, 0.0, 0
    depth = 0
    if depth_of:
        cursor[0] = first[0]
    while depth >= 0 and depth_of:
        n = placed[depth]
        promising = n + depth_of - depth > most or (n + depth_of - depth == most and total[depth] < least)
        if depth == depth_of or not promising or cursor[depth] > last[depth]:
            depth -= 1
            continue
        place = cursor[depth]
        cursor[depth] += 1
        if place == last[depth]:  # every landmark has been tried: none
            chosen[depth] = NONE
            placed[depth + 1], total[depth + 1] = n, total[depth]
        else:
            c = int(pairs.by_distance[place])
            if _is_taken(pairs, taken, n, c):
                continue
            if nodes >= node_limit:
                break
            nodes += 1
            distance = _extend(cov, covs, pairs, taken, n, c, U, y) + total[depth]
            if not distance <= quantiles[n + 1]:
                continue
            taken[n] = c
            chosen[depth] = c
            placed[depth + 1], total[depth + 1] = n + 1, distance
            if n + 1 > most or (n + 1 == most and distance < least):
                most, least = n + 1, distance
                best[:] = NONE
                for d in range(depth + 1):
                    if chosen[d] != NONE:
                        best[rows[d]] = pairs.slot[chosen[d]]
        depth += 1
        if depth < depth_of:
            cursor[depth] = first[depth]
    return nodes


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
    cov: Float, covs: Float, pairs: Pairs, count: int, gate: float, margin: float, best: Int, ambiguous: Marks
) -> None:
    """Mark the observations whose landmarks in `best` another association explains nearly as well.

    Tried are those that give one observation a landmark that is free, or let two of them change places; nearly
    is a joint d^2 within `margin`: such an alternative is at least exp(-margin / 2) times as likely.
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
    least = -1.0
    for c in range(count):
        i = pairs.observation[c]
        if chosen[i] == NONE or chosen[i] == c or pairs.distance[c] > gate:
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
        if _joint_distance(cov, covs, pairs, alternative) <= least + margin:
            ambiguous[i] = True


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
