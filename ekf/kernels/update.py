"""The update that all filters share: gain, covariance, retraction; compiled.

The gain K = P H' S^-1 is never formed. With S = U'U, W = U'^-1 H P and y = U'^-1 v, the correction is K v = W'y and the
covariance decreases by K S K' = W'W. The filters differ in three places:

* **Jacobians.** The first-estimates filter takes them at another `point`: the first estimate of each landmark and the
  predicted pose. Rotation and translation of the whole map then stay unobservable, because H F...F N = 0 for
  N = [I, J p; 0, 1; I, J l]. The observability-constrained filter takes them at the newest estimate and replaces H by
  the nearest matrix with H N = 0 (`linearisation.project_on_observable`).
* **Iteration.** The iterated filter repeats the gain with Jacobians at the result (Gauss-Newton):
  x_{i+1} = x^ + K_i (z - h(x_i) - H_i (x^ - x_i)). After a pass that goes back by more than half of the one before, or
  that is longer and does not go on in its direction, later ones are half as long. If `PASSES` of them do not settle,
  the last one is used, and the caller prints a notice.
* **Retraction.** The others add dx. The error xi of the right-invariant filter is defined by theta = theta^ + xi_theta
  and p = R(xi_theta) p^ + V(xi_theta) xi_p (the same for landmarks). To first order it is xi = D^-1 (additive error),
  D = [I, J p; 0, 1] with landmark rows [I, J l]. Prediction, Jacobians and augmentation are therefore those of the
  standard filter. Because V(t) t J = R(t) - I, the retraction exp(xi) moves every point by V(dtheta) dx. D changes with
  the estimate: P <- T P T' with T = D(after) D(before)^-1 = I + u e_theta', u = J (after - before) for positions.

Rows of W may stay pending: P = cov - W'W + sum_k (u_k a_k' + a_k u_k'). A scan without ids corrects with one
observation after the other, and changes the whole covariance at its end only.

Sources: Huang, Mourikis and Roumeliotis, IJRR 29(5), 2010 (first estimates, observability constraints); Bell and
Cathey, IEEE Transactions on Automatic Control 38(2), 1993 (iterated); Barrau and Bonnabel, arXiv 1510.06263 (2015) and
Zhang et al., RA-L 2017 (right-invariant).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE, ROBOT, Belief, Pending, Workspace, at_place
from slamgauge.ekf.kernels.blas import add_outer_pairs, cholesky, combine_rows, solve_factor, subtract_gram
from slamgauge.ekf.kernels.covariance import innovation_covariance, mirror_robot_block, project_covariance
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.precision import (
    EXHAUSTED,
    LEAST_SHARE,
    are_pivots_lost,
    are_variances_lost,
    backup,
    restore,
)
from slamgauge.ekf.kernels.soundness import are_sound
from slamgauge.formula_kernels import mean_rotation, wrap
from slamgauge.jit import inner, kernel

PASSES = 1000  # most passes of the iterated filter
STATE_ROUNDING = 1e-14  # rounding of a state entry, relative to 1 m or its value
SETTLED = 1e-13  # step of its last pass, in standard deviations of the prior
LAST_DIGITS = 1e-7  # a smaller step that does not shrink is rounding


class Form(NamedTuple):
    """What distinguishes the filters."""

    invariant: bool = False  # right-invariant retraction
    iterated: bool = False  # whether an update is repeated with Jacobians at its result
    tails: float = math.inf  # degrees of freedom of the noise (see `student_t`)


@kernel
def find_slots(sorted_ids: Int, sorted_slots: Int, count: int, ids: Int, slots: Int) -> int:
    """Fill the first `count` slots with those of the ids by bisection, NONE if unmapped; return the number of these."""
    unmapped = 0
    for i in range(count):
        low, high = 0, len(sorted_ids)
        while low < high:
            middle = (low + high) // 2
            if sorted_ids[middle] < ids[i]:
                low = middle + 1
            else:
                high = middle
        if low < len(sorted_ids) and sorted_ids[low] == ids[i]:
            slots[i] = sorted_slots[low]
        else:
            slots[i] = NONE
            unmapped += 1
    return unmapped


@kernel
def update(sensor: int, belief: Belief, count: int, invariant: bool, work: Workspace) -> tuple[float, int]:
    """Correct with the first `count` observations of `work`; return the NIS and its degrees of freedom.

    If the NIS is not finite, the belief is unchanged.
    """
    if not are_sound(sensor, work.observation[:count], work.observation_cov[:count]):
        return math.nan, 0
    return update_blocks(sensor, belief, count, invariant, work)


@inner
def update_blocks(sensor: int, belief: Belief, count: int, invariant: bool, work: Workspace) -> tuple[float, int]:
    """Do `update` with sound observations, in blocks of the workspace, all with Jacobians at the same point.

    The result is that of a single block, because observations are independent, but the triangular solve is cheaper: its
    cost grows with the square of the block.
    """
    slots, values = work.slots[:count], work.observation[:count]
    size, block = belief.size, len(work.S) // 2
    informative = linearise(sensor, belief, slots, values, work.innovation, work.jacobian)
    before = backup(belief, count, block, work)
    dx, found, nis = np.zeros(size), np.zeros(size), 0.0
    for first in range(0, count, block):
        last = min(first + block, count)
        rows = slice(2 * first, 2 * last)
        subtract_projection(dx, slots[first:last], work.jacobian[rows], work.innovation[rows])
        nis += correction(belief, (first, last), None, work, found)
        if not math.isfinite(nis):
            if first > 0:
                restore(belief.cov, before)
            return nis, informative
        for j in range(size):
            dx[j] += found[j]
        apply(belief, Pending(2 * (last - first), 0), work)
    retract(belief, dx, invariant, work)
    return nis, informative


@kernel
def update_iterated(
    sensor: int, belief: Belief, count: int, invariant: bool, work: Workspace
) -> tuple[float, int, int]:
    """Do `update` with the iterated filter, which needs a workspace of one block; also return the number of passes."""
    slots, values = work.slots[:count], work.observation[:count]
    if not are_sound(sensor, values, work.observation_cov[:count]):
        return math.nan, 0, 1
    informative, dx = linearise(sensor, belief, slots, values, work.innovation, work.jacobian), np.zeros(belief.size)
    nis = correction(belief, (0, count), None, work, dx)
    last, passes = iterate(sensor, belief, (0, count), None, work, dx) if math.isfinite(nis) else (nis, 1)
    if not math.isfinite(last):
        return last, informative, passes
    apply(belief, Pending(2 * count, 0), work)
    retract(belief, dx, invariant, work)
    return nis, informative, passes


@inner
def correction(belief: Belief, rows: tuple[int, int], pending: Pending | None, work: Workspace, dx: Float) -> float:
    """Compute the gain of observations `rows` (first, last) and their correction dx (size,); return the NIS.

    `work` contains their innovations v and Jacobians H; W and y replace H P and v, and the rows of W follow the pending
    ones (None without; numba then compiles less). The NIS y'y is NaN if S is not positive definite, and `EXHAUSTED` if
    S or P would only be rounding. `work.pivots` receives the diagonal of U.
    """
    first, last = rows
    height, S = 2 * (last - first), work.S
    slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
    above, pairs = 0, 0
    if pending is not None:
        above, pairs = pending.rows, pending.pairs
    y, W = work.innovation[2 * first : 2 * last], work.W[above : above + height]
    project_covariance(belief.cov, belief.size, slots, jacobian, W)
    if pending is not None:
        project_pending(W, slots, jacobian, pending, work, belief.size)
    innovation_covariance(W, slots, jacobian, work.observation_cov[first:last], S)
    nis = whiten(S, W, y, height, belief.size)
    if not math.isfinite(nis):
        return nis
    changed = Pending(above + height, pairs)
    if are_pivots_lost(S, belief.cov, slots, jacobian) or are_variances_lost(belief.cov, slots, changed, work):
        return EXHAUSTED
    combine_rows(W, y, dx, height, belief.size)
    for a in range(height):
        work.pivots[2 * first + a] = S[a, a]
    return nis


@inner
def iterate(
    sensor: int, belief: Belief, rows: tuple[int, int], pending: Pending | None, work: Workspace, dx: Float
) -> tuple[float, int]:
    """Repeat the correction dx (size,) with Jacobians at its result until it settles; see the head of this file.

    Returns the NIS of the last pass, which is not finite if no update exists, and the number of passes.
    """
    first, last = rows
    slots, values = work.slots[first:last], work.observation[first:last]
    y, jacobian = work.innovation[2 * first : 2 * last], work.jacobian[2 * first : 2 * last]
    state, offset, there = belief.state, np.zeros(belief.size), at_place(belief, belief.state.copy())
    step, before, shortening = np.zeros(belief.size), math.inf, 1.0
    for passes in range(1, PASSES):
        longest, back, previous = 0.0, 0.0, 0.0  # in variances of the prior
        for j in range(belief.size):
            earlier, step[j] = step[j], shortening * (dx[j] + offset[j])  # offset: minus the correction so far
            if abs(step[j]) > STATE_ROUNDING * (1.0 + abs(state[j])) and belief.cov[j, j] > 0.0:
                longest = max(longest, step[j] * step[j] / belief.cov[j, j])
                back -= step[j] * earlier / belief.cov[j, j]
                previous += earlier * earlier / belief.cov[j, j]
            offset[j] -= step[j]
            there.state[j] = state[j] - offset[j]
        if longest < (shortening * SETTLED) ** 2 or (longest < LAST_DIGITS**2 and longest >= before):
            return 0.0, passes
        if back > 0.5 * previous or (longest > before and back >= 0.0):
            shortening *= 0.5
        before = longest
        linearise(sensor, there, slots, values, y, jacobian)
        subtract_projection(offset, slots, jacobian, y)
        nis = correction(belief, rows, pending, work, dx)
        if not math.isfinite(nis):
            return nis, passes
    return 0.0, PASSES


@inner
def project_pending(W: Float, slots: Int, jacobian: Float, pending: Pending, work: Workspace, size: int) -> None:
    """Add the pending changes of P to W = H P."""
    for k in range(W.shape[0]):
        h, landmark = jacobian[k], ROBOT + 2 * slots[k // 2]
        for r in range(pending.rows):
            w, share = work.W[r], seen_by(h, work.W[r], landmark)
            for j in range(size):
                W[k, j] -= share * w[j]
        for r in range(pending.pairs):
            u, a = work.u[r], work.a[r]
            of_u, of_a = seen_by(h, u, landmark), seen_by(h, a, landmark)
            for j in range(size):
                W[k, j] += of_u * a[j] + of_a * u[j]


@inner
def seen_by(h: Float, row: Float, landmark: int) -> float:
    """Return the product of a row of a Jacobian h (5,) with a row (size,) of state entries."""
    return h[0] * row[0] + h[1] * row[1] + h[2] * row[2] + h[3] * row[landmark] + h[4] * row[landmark + 1]


@inner
def whiten(S: Float, W: Float, y: Float, rows: int, size: int) -> float:
    """S <- U, W <- U'^-1 W and y <- U'^-1 y for S = U'U; return y'y.

    The result is NaN if S is not positive definite, and `EXHAUSTED` if a pivot of S is only rounding of its variance.
    """
    if not cholesky(S, rows):
        return math.nan
    solve_factor(S, W, rows, size)
    squared = 0.0
    for a in range(rows):
        explained = 0.0
        for b in range(a):
            y[a] -= S[b, a] * y[b]
            explained += S[b, a] * S[b, a]
        pivot = S[a, a] * S[a, a]
        if pivot <= LEAST_SHARE * (pivot + explained):
            return EXHAUSTED
        y[a] /= S[a, a]
        squared += y[a] * y[a]
    return squared


@inner
def apply(belief: Belief, pending: Pending, work: Workspace) -> None:
    """Change the covariance by the pending rows and pairs of `work`."""
    if pending.rows:
        subtract_gram(belief.cov, work.W, pending.rows, belief.size)
    if pending.pairs:
        add_outer_pairs(belief.cov, work.u, work.a, pending.pairs, belief.size)
    mirror_robot_block(belief.cov)


@kernel
def retract(belief: Belief, dx: Float, invariant: bool, work: Workspace) -> None:
    """Move the state by dx (size,), and for the right-invariant filter transform the covariance: P <- T P T'."""
    if invariant:
        move_invariantly(belief, dx, None, work)
        apply(belief, Pending(0, 1), work)
    else:
        move_additively(belief, dx)


@inner
def move_additively(belief: Belief, dx: Float) -> None:
    """Add dx to all entries."""
    for i in range(belief.size):
        belief.state[i] += dx[i]
    belief.state[2] = wrap(belief.state[2])


@inner
def move_invariantly(belief: Belief, dx: Float, pending: Pending | None, work: Workspace) -> None:
    """Move every point by V(dtheta) dx and all other entries by dx; add the pair of P <- T P T' to the pending ones.

    T P T' = P + u a' + a u' with a = P e_theta + u P_theta,theta / 2.
    """
    state, size = belief.state, belief.size
    pair = 0 if pending is None else pending.pairs
    u, a = work.u[pair], work.a[pair]
    v_cos, v_sin = mean_rotation(dx[2])
    _turn(state, dx, u, 0, v_cos, v_sin)
    for k in range(ROBOT, size, 2):
        if belief.points[(k - ROBOT) // 2]:
            _turn(state, dx, u, k, v_cos, v_sin)
        else:
            state[k], state[k + 1] = state[k] + dx[k], state[k + 1] + dx[k + 1]
            u[k], u[k + 1] = 0.0, 0.0
    state[2] = wrap(state[2] + dx[2])
    u[2] = 0.0
    for j in range(size):
        a[j] = belief.cov[min(2, j), max(2, j)]
    if pending is not None:
        for r in range(pending.rows):
            w = work.W[r]
            for j in range(size):
                a[j] -= w[2] * w[j]
        for r in range(pending.pairs):
            for j in range(size):
                a[j] += work.a[r, 2] * work.u[r, j]
    half = 0.5 * a[2]
    for j in range(size):
        a[j] += half * u[j]


@inner
def _turn(state: Float, dx: Float, u: Float, i: int, v_cos: float, v_sin: float) -> None:
    """Move the point at entry i by V dx, and set its entries of u to J V dx."""
    move_x, move_y = v_cos * dx[i] - v_sin * dx[i + 1], v_sin * dx[i] + v_cos * dx[i + 1]
    state[i] += move_x
    state[i + 1] += move_y
    u[i], u[i + 1] = -move_y, move_x
