"""The update that all filters share: gain, covariance, retraction; compiled.

The gain K = P H' S^-1 is never formed. With S = U'U, W = U'^-1 H P and y = U'^-1 v, the correction is K v = W'y and the
covariance decreases by K S K' = W'W. The filters differ in three places:

* **Jacobians.** The first-estimates filter takes them at another `point`: the first estimate of each landmark and the
  predicted pose. Rotation and translation of the whole map then stay unobservable, because H F...F N = 0 for
  N = [I, J p; 0, 1; I, J l]. The observability-constrained filter takes them at the newest estimate and replaces H by
  the nearest matrix with H N = 0 (`linearisation.project_on_observable`).
* **Iteration.** The iterated filter repeats the gain with Jacobians at the result (Gauss-Newton):
  x_{i+1} = x^ + K_i (z - h(x_i) - H_i (x^ - x_i)). After a pass that was longer than the one before, later ones
  are half as long.
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
from slamgauge.ekf.kernels.belief import ROBOT, Belief, Workspace, at_place
from slamgauge.ekf.kernels.blas import (
    add_outer_pairs,
    cholesky,
    combine_rows,
    solve_factor,
    subtract_gram,
)
from slamgauge.ekf.kernels.covariance import (
    innovation_covariance,
    is_symmetric,
    mirror_robot_block,
    project_covariance,
)
from slamgauge.ekf.kernels.linearisation import inflate_noise, linearise, subtract_projection
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import mean_rotation, wrap
from slamgauge.sensor_kernels import HAS_RANGE
from slamgauge.validation import LARGEST

LEAST = 1e-13  # smallest difference of two numbers, relative to the larger one, that is more than rounding
SAFE = 1e-3  # share of the information that would exhaust double precision; below it, no backup of P is needed
EXHAUSTED = math.inf  # NIS of an update that exhausts double precision
PASSES = 1000  # most passes of the iterated filter; the result of the last one counts
ROUNDING = 1e-14  # of a state entry, relative to 1 m or its value
SETTLED = 1e-13  # step of its last pass, in standard deviations of the prior
LAST_DIGITS = 1e-7  # a smaller step that does not shrink is rounding


class Form(NamedTuple):
    """What distinguishes the filters."""

    invariant: bool = False  # right-invariant retraction
    passes: int = 1  # most linearisations of an update; above 1 for the iterated filter
    tails: float = math.inf  # degrees of freedom of the noise (see `linearisation.inflate_noise`)


class Pending(NamedTuple):
    """Number of pending rows of W, and of pending pairs u, a."""

    rows: int
    pairs: int


NOTHING = Pending(0, 0)


@kernel
def update(sensor: int, belief: Belief, count: int, form: Form, work: Workspace) -> tuple[float, int]:
    """Correct with the first `count` observations of `work`; return the NIS and its degrees of freedom.

    The observations are processed in blocks of the workspace, all with Jacobians at the same point. The result is that
    of a single block, because observations are independent, but the triangular solve is cheaper: its cost grows with
    the square of the block. If the NIS is not finite, the belief is unchanged.
    """
    slots, values, covs = work.slots[:count], work.observation[:count], work.observation_cov[:count]
    if not are_sound(sensor, values, covs):
        return math.nan, 0
    if form.tails < math.inf:
        inflate_noise(sensor, belief, slots, values, covs, form.tails)
    size, block = belief.size, count if form.passes > 1 else len(work.S) // 2
    if 2 * block > len(work.S):
        return math.nan, 0  # the workspace is too small
    linearise(sensor, belief, slots, values, work.innovation, work.jacobian)
    before = _backup(belief, count, block, work)
    dx, found, nis, informative = np.zeros(size), np.zeros(size), 0.0, 0
    for first in range(0, count, block):
        last = min(first + block, count)
        added, dof = correction(sensor, belief, (first, last), NOTHING, form, work, dx, found)
        nis, informative = nis + added, informative + dof
        if not math.isfinite(nis):
            if first > 0:
                _restore(belief.cov, before)
            return nis, informative
        for j in range(size):
            dx[j] += found[j]
        apply(belief, Pending(2 * (last - first), 0), work)
    retract(belief, dx, form.invariant, work)
    return nis, informative


@inner
def correction(
    sensor: int,
    belief: Belief,
    rows: tuple[int, int],
    pending: Pending,
    form: Form,
    work: Workspace,
    done: Float,
    dx: Float,
) -> tuple[float, int]:
    """Compute the correction dx (size,) by observations `rows` (first, last); return the NIS and its dof.

    The rows of W follow the pending ones. `done` (size,) is the correction by earlier blocks of the same scan. Nothing
    is changed.
    """
    (first, last), state = rows, belief.state
    height, nis, shortening = 2 * (last - first), 0.0, 1.0
    slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
    y, W = work.innovation[2 * first : 2 * last], work.W[pending.rows : pending.rows + height]
    there, offset, informative, before = belief, done, 0, math.inf
    for k in range(form.passes):
        dof = linearise(sensor, there, slots, work.observation[first:last], y, jacobian)
        subtract_projection(offset, slots, jacobian, y)
        found = gain(belief, slots, work.observation_cov[first:last], jacobian, y, W, pending, work)
        changes = Pending(pending.rows + height, pending.pairs)
        if math.isfinite(found) and are_variances_lost(belief.cov, slots, changes, work):
            found = EXHAUSTED
        if k == 0:
            nis, informative = found, dof
        if not math.isfinite(found):
            return found, informative
        combine_rows(W, y, dx, height, belief.size)
        if form.passes == 1:
            return nis, informative
        if k == 0:
            offset, there = np.zeros(belief.size), at_place(belief, state.copy())
        longest = 0.0
        for j in range(belief.size):
            step = shortening * (dx[j] + offset[j])  # offset: minus the correction so far
            if abs(step) > ROUNDING * (1.0 + abs(state[j])) and belief.cov[j, j] > 0.0:
                longest = max(longest, step * step / belief.cov[j, j])
            offset[j] -= step
            there.state[j] = state[j] - offset[j]
        if longest < (shortening * SETTLED) ** 2 or (longest < LAST_DIGITS**2 and longest >= before):
            return nis, informative
        if longest > before:
            shortening *= 0.5
        before = longest
    return nis, informative


@inner
def gain(
    belief: Belief,
    slots: Int,
    noise_cov: Float,
    jacobian: Float,
    y: Float,
    W: Float,
    pending: Pending,
    work: Workspace,
) -> float:
    """Compute W and y of observations (m,) with innovations `y` (2m,), and S <- U; return y'y.

    The result is NaN if S is not positive definite, and `EXHAUSTED` if a pivot of S is only rounding.
    """
    S, rows = work.S, 2 * len(slots)
    project(belief, slots, jacobian, W, pending, work)
    innovation_covariance(W, slots, jacobian, noise_cov, S)
    if not cholesky(S, rows):
        return math.nan
    solve_factor(S, W, rows, belief.size)
    squared = whiten(S, y, rows)
    if math.isfinite(squared) and are_pivots_lost(S, belief.cov, slots, jacobian):
        return EXHAUSTED
    return squared


@inner
def project(belief: Belief, slots: Int, jacobian: Float, W: Float, pending: Pending, work: Workspace) -> None:
    """Compute W = H P, with the pending changes of P."""
    size = belief.size
    project_covariance(belief.cov, size, slots, jacobian, W)
    for k in range(W.shape[0] if pending.rows else 0):
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
def whiten(U: Float, y: Float, rows: int) -> float:
    """Y <- U'^-1 y; return y'y, or `EXHAUSTED` if a pivot of S = U'U is only rounding of its variance."""
    squared = 0.0
    for a in range(rows):
        explained = 0.0
        for b in range(a):
            y[a] -= U[b, a] * y[b]
            explained += U[b, a] * U[b, a]
        pivot = U[a, a] * U[a, a]
        if pivot <= LEAST * (pivot + explained):
            return EXHAUSTED
        y[a] /= U[a, a]
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
        move_invariantly(belief, dx, NOTHING, work)
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
def move_invariantly(belief: Belief, dx: Float, pending: Pending, work: Workspace) -> None:
    """Move every point by V(dtheta) dx and all other entries by dx; add the pair of P <- T P T' to the pending ones.

    T P T' = P + u a' + a u' with a = P e_theta + u P_theta,theta / 2.
    """
    state, size = belief.state, belief.size
    u, a = work.u[pending.pairs], work.a[pending.pairs]
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


@inner
def are_pivots_lost(U: Float, cov: Float, slots: Int, jacobian: Float) -> bool:
    """Return whether a pivot of S = U'U = H P H' + R is only rounding of H P H'."""
    for k in range(2 * len(slots)):
        if not U[k, k] * U[k, k] > LEAST * _entered(cov, jacobian[k], ROBOT + 2 * slots[k // 2]):
            return True
    return False


@inner
def _entered(cov: Float, h: Float, landmark: int) -> float:
    """Return the sum of h^2 P over the five entries of a row of H: a fifth of an upper bound of h P h'."""
    entered = h[0] * h[0] * cov[0, 0] + h[1] * h[1] * cov[1, 1] + h[2] * h[2] * cov[2, 2]
    return entered + h[3] * h[3] * cov[landmark, landmark] + h[4] * h[4] * cov[landmark + 1, landmark + 1]


@inner
def are_variances_lost(cov: Float, slots: Int, pending: Pending, work: Workspace) -> bool:
    """Return whether P with its pending changes is only rounding, for the robot's position or heading or for `slots`.

    A double has 16 digits; three must be left. The two variances of a position are added, because one of them may be
    zero from the start.
    """
    if _is_lost(cov, pending, work, 0, 2) or _is_lost(cov, pending, work, 2, 1):
        return True
    for slot in slots:  # noqa: SIM110 numba compiles no generator expressions
        if _is_lost(cov, pending, work, ROBOT + 2 * slot, 2):
            return True
    return False


@inner
def _is_lost(cov: Float, pending: Pending, work: Workspace, first: int, count: int) -> bool:
    """Return whether the sum of `count` variances from entry `first` on is only rounding."""
    before, taken = 0.0, 0.0
    for j in range(first, first + count):
        before += cov[j, j]
        for k in range(pending.rows):
            taken += work.W[k, j] * work.W[k, j]
        for k in range(pending.pairs):
            before += 2.0 * work.u[k, j] * work.a[k, j]
    return taken > 0.0 and not before - taken > LEAST * before


@inner
def _backup(belief: Belief, count: int, block: int, work: Workspace) -> Float:
    """Return a copy of P if a block after the first might exhaust double precision, else an empty array.

    A scan reduces no variance to less than 1 / (1 + tr(R^-1 H P H')) of its value, no pivot of S is smaller than the
    same pivot of R, and (H P H')_aa is at most five times the sum of h^2 P. If these bounds are far from exhausting
    double precision, every block has an update.
    """
    information, h = 0.0, work.jacobian
    for i in range(count if count > block else 0):
        R, landmark = work.observation_cov[i], ROBOT + 2 * work.slots[i]
        determinant = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        least = determinant / (R[0, 0] + R[1, 1])  # at most the smallest eigenvalue
        information += R[0, 0] * R[1, 1] / determinant  # a pivot of R is at least this share of its variance
        for k in (2 * i, 2 * i + 1):
            information += 5.0 * _entered(belief.cov, h[k], landmark) / least
    needed = 0 if 0.0 <= information < SAFE / LEAST else belief.size
    return belief.cov[:needed, :needed].copy()


@inner
def _restore(cov: Float, backup: Float) -> None:
    """Copy a backup (n, n) of P to its first rows and columns."""
    for i in range(len(backup)):
        for j in range(len(backup)):
            cov[i, j] = backup[i, j]


@kernel
def are_sound(sensor: int, values: Float, covs: Float) -> bool:
    """Return whether observations (m, 2) and their covariances (m, 2, 2) are valid.

    Values are below `LARGEST`, ranges are not negative, and covariances are positive definite.
    """
    for i in range(len(values)):
        R = covs[i]
        if not (abs(values[i, 0]) < LARGEST and abs(values[i, 1]) < LARGEST):
            return False
        if HAS_RANGE[sensor] and values[i, 0] < 0.0:
            return False
        product = R[0, 0] * R[1, 1]
        if not (R[0, 0] > 0.0 and product - R[0, 1] * R[1, 0] > 0.0 and R[0, 0] + R[1, 1] < LARGEST * LARGEST):
            return False
        if not is_symmetric(R[0, 1], R[1, 0], product, max(R[0, 0], R[1, 1])):
            return False
    return True
