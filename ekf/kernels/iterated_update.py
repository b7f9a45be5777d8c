"""The iterated update: the minimum of the cost of the prior and the observations of a step, and the gain there.

The cost is c(x) = (x - x^)' P^-1 (x - x^) + v' R^-1 v, with innovations v = z - h(x). Once its minimum x* is known, all
else is one linear update with Jacobians there: x^ + K (v + H (x* - x^)), P - K H P. See `kernels.iterated_minimum`.

Source: Bell and Cathey, IEEE Transactions on Automatic Control 38(2), 1993.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT, Belief, at_place
from slamgauge.ekf.kernels.blas import combine_rows, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.iterated_minimum import Seen, find_minimum, silence
from slamgauge.ekf.kernels.joint_update import are_sound, whiten
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, NO_MINIMUM, are_variances_lost
from slamgauge.ekf.kernels.workspace import CORRECTION, PLACE, WAY_BACK, Workspace
from slamgauge.jit import kernel
from slamgauge.se2_kernels import wrap

MAX_PASSES = 2000  # some are needed where rays contradict each other; a dozen is much elsewhere


@kernel
def update_iterated(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct with Jacobians where the correction leads; returns as `update_standard`, the NIS of the first pass."""
    return iterate(sensor, belief, count, work, MAX_PASSES)


@kernel
def iterate(sensor: int, belief: Belief, count: int, work: Workspace, passes: int) -> tuple[float, int]:
    """`update_iterated` with at most `passes` linearisations; a single one is the standard update.

    The workspace must take in a whole scan at a time; if it does not, there is no update.
    """
    state, size = belief.state, belief.size
    slots, values, covs = work.slots[:count], work.observation[:count], work.observation_cov[:count]
    if 2 * count > len(work.W) or not are_sound(sensor, values, covs):
        return math.nan, 0
    informative = linearise(sensor, at_place(belief, state), slots, values, work.innovation, work.jacobian)
    nis = whiten(belief, 0, count, work)
    if not math.isfinite(nis):
        return nis, informative
    entries, local = involved_entries(slots)
    there = state[entries]
    if passes > 1:
        seen = Seen(sensor, local, values, covs, np.zeros(count, dtype=np.bool_))
        if not find_minimum(there, block(belief.cov, entries), seen, passes):
            return NO_MINIMUM, informative
        place, back = work.scratch[PLACE], work.scratch[WAY_BACK]
        for a in range(len(entries)):
            place[entries[a]] = there[a]
            back[entries[a]] = state[entries[a]] - there[a]
        linearise(sensor, at_place(belief, place), slots, values, work.innovation, work.jacobian)
        silence(seen.blind, work.innovation, work.jacobian)
        subtract_projection(back, 0, count, work)
        last = whiten(belief, 0, count, work)
        if not math.isfinite(last):
            return last, informative
    if are_variances_lost(belief.cov, slots, work.W, 2 * count):
        return EXHAUSTED, informative
    dx = work.scratch[CORRECTION]
    combine_rows(work.W, work.innovation, dx, 2 * count, size)
    for j in range(size):
        state[j] += dx[j]
    if passes > 1:  # dx leads there, but for digits that its sums lose
        state[entries] = there
    state[2] = wrap(state[2])
    subtract_gram(belief.cov, work.W, 2 * count, size)
    mirror_robot_block(belief.cov)
    return nis, informative


@kernel
def involved_entries(slots: Int) -> tuple[Int, Int]:
    """Entries of the robot and of the landmarks in `slots` (m,), and for each of these its slot among them (m,)."""
    entries, local = np.empty(ROBOT + 2 * len(slots), dtype=np.int64), np.empty(len(slots), dtype=np.int64)
    for j in range(ROBOT):
        entries[j] = j
    found = 0
    for i in range(len(slots)):
        local[i] = found
        for k in range(i):  # a landmark may be seen twice in a scan
            if slots[k] == slots[i]:
                local[i] = local[k]
                break
        if local[i] == found:
            entries[ROBOT + 2 * found] = ROBOT + 2 * slots[i]
            entries[ROBOT + 2 * found + 1] = ROBOT + 2 * slots[i] + 1
            found += 1
    return entries[: ROBOT + 2 * found].copy(), local


@kernel
def block(cov: Float, entries: Int) -> Float:
    """The entries' covariance (n, n), all of it, from the upper triangle of P."""
    P = np.empty((len(entries), len(entries)))
    for a in range(len(entries)):
        for b in range(len(entries)):
            P[a, b] = cov[min(entries[a], entries[b]), max(entries[a], entries[b])]
    return P
