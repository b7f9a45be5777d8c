"""The iterated update: a linear update with Jacobians at the minimum of the cost of prior and scan, compiled.

The cost is c(x) = (x - x^)' P^-1 (x - x^) + v' R^-1 v, with innovations v = z - h(x). `kernels.iterated_minimum` finds
its minimum x*. One linear update with Jacobians at x* follows: x^ + K (v + H (x* - x^)), P - K H P.

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
from slamgauge.ekf.kernels.linearisation import linearise_scan, subtract_projection
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, NO_MINIMUM, are_variances_lost
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import wrap

MAX_PASSES = 2000  # hundreds are needed if the rays of bearings contradict each other, else rarely more than a dozen


@kernel
def update_iterated(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct with Jacobians at the minimum of the cost; return the NIS at the prior and its degrees of freedom."""
    return iterate(sensor, belief, count, work, MAX_PASSES)


@kernel
def iterate(sensor: int, belief: Belief, count: int, work: Workspace, passes: int) -> tuple[float, int]:
    """Compute `update_iterated` with at most `passes` linearisations; with one it is the standard update.

    The NIS is NaN if a block of the workspace is too small for the whole scan.
    """
    state, size = belief.state, belief.size
    slots, values, covs = work.slots[:count], work.observation[:count], work.observation_cov[:count]
    if 2 * count > len(work.W) or not are_sound(sensor, values, covs):
        return math.nan, 0
    scan, informative = linearise_scan(sensor, at_place(belief, state), count, work)
    gain = whiten(belief, scan, 0, count, work)
    nis = gain.nis
    if not math.isfinite(nis):
        return nis, informative
    entries, local = involved_entries(slots)
    minimum = state[entries]
    if passes > 1:
        seen = Seen(sensor, local, values, covs, np.zeros(count, dtype=np.bool_))
        if not find_minimum(minimum, block(belief.cov, entries), seen, passes):
            return NO_MINIMUM, informative
        place, to_prior = np.zeros(size), np.zeros(size)  # entries that no observation involves are not read
        for a in range(len(entries)):
            place[entries[a]] = minimum[a]
            to_prior[entries[a]] = state[entries[a]] - minimum[a]
        scan, _ = linearise_scan(sensor, at_place(belief, place), count, work)
        silence(seen.blind, scan.innovation, scan.jacobian)
        subtract_projection(to_prior, scan, 0, count)
        gain = whiten(belief, scan, 0, count, work)
        if not math.isfinite(gain.nis):
            return gain.nis, informative
    if are_variances_lost(belief.cov, slots, gain.W, 2 * count):
        return EXHAUSTED, informative
    dx = np.empty(size)
    combine_rows(gain.W, gain.y, dx, 2 * count, size)
    for j in range(size):
        state[j] += dx[j]
    if passes > 1:  # the minimum equals x + dx up to the rounding of sums
        state[entries] = minimum
    state[2] = wrap(state[2])
    subtract_gram(belief.cov, gain.W, 2 * count, size)
    mirror_robot_block(belief.cov)
    return nis, informative


@inner
def involved_entries(slots: Int) -> tuple[Int, Int]:
    """Return the entries of the robot and of the landmarks in `slots` (m,), and the slot of each among these (m,)."""
    entries, local = np.empty(ROBOT + 2 * len(slots), dtype=np.int64), np.empty(len(slots), dtype=np.int64)
    for j in range(ROBOT):
        entries[j] = j
    found = 0
    for i in range(len(slots)):
        local[i] = found
        for k in range(i):  # a scan may observe a landmark twice
            if slots[k] == slots[i]:
                local[i] = local[k]
                break
        if local[i] == found:
            entries[ROBOT + 2 * found] = ROBOT + 2 * slots[i]
            entries[ROBOT + 2 * found + 1] = ROBOT + 2 * slots[i] + 1
            found += 1
    return entries[: ROBOT + 2 * found].copy(), local


@inner
def block(cov: Float, entries: Int) -> Float:
    """Return the covariance (n, n) of the entries, both triangles, from the upper triangle of P."""
    P = np.empty((len(entries), len(entries)))
    for a in range(len(entries)):
        for b in range(len(entries)):
            P[a, b] = cov[min(entries[a], entries[b]), max(entries[a], entries[b])]
    return P
