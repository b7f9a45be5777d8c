"""What all corrections have in common: the gain of a scan and the covariance after it, compiled."""

from __future__ import annotations

import math

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import ROBOT, Belief
from slamgauge.ekf.kernels.blas import cholesky, combine_rows, solve_factor, subtract_gram
from slamgauge.ekf.kernels.covariance import innovation_covariance, is_symmetric, mirror_robot_block, project_covariance
from slamgauge.ekf.kernels.deferred_downdate import may_wait, postpone, settle, subtract_waiting
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LARGEST, LEAST, are_pivots_lost, are_variances_lost
from slamgauge.ekf.kernels.workspace import BLOCK_CORRECTION, CORRECTION, Workspace
from slamgauge.jit import kernel
from slamgauge.sensor_kernels import HAS_RANGE

SAFE = 1e-3  # of what exhausts precision


@kernel
def whiten(belief: Belief, first: int, last: int, work: Workspace) -> float:
    """Prepare to take in observations first..last, which `linearise` has described in `work`.

    Leaves W = U'^-1 H P and the whitened innovation y = U'^-1 v in `work` (y in its own rows), where S = U'U,
    so that the correction is W'y and the covariance decreases by W'W. Returns the NIS, which is not finite
    when S is not positive definite, is rounding (`EXHAUSTED`), or an observation is not finite.
    """
    rows = 2 * (last - first)
    slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
    W, S, y = work.W, work.S, work.innovation[2 * first : 2 * last]
    project_covariance(belief.cov, belief.size, slots, jacobian, W)
    if work.waiting.used[0] > 0:
        subtract_waiting(work.waiting, belief.size, slots, jacobian, W)
    innovation_covariance(W, slots, jacobian, work.observation_cov[first:last], S)
    nis = divide_by_factor(S, W, y, rows, belief.size)
    if math.isfinite(nis) and are_pivots_lost(S, belief.cov, slots, jacobian):
        return EXHAUSTED
    return nis


@kernel
def divide_by_factor(S: Float, W: Float, y: Float, rows: int, size: int) -> float:
    """W <- U'^-1 W and y <- U'^-1 y, where S = U'U; returns y'y.

    That is NaN when S is not positive definite, and `EXHAUSTED` when a pivot is the rounding of its variance.
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
        if pivot <= LEAST * (pivot + explained):
            return EXHAUSTED
        y[a] /= S[a, a]
        squared += y[a] * y[a]
    return squared


@kernel
def take_in(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """P <- P - W'W for the first `count` observations, and their correction dx in the workspace's row CORRECTION.

    Block by block of the workspace, all with the same Jacobians: for independent observations that is the same as all
    at once, and saves the triangular solve that grows with the square of a block. Part of it may wait (see `waiting`).
    Returns the NIS and its degrees of freedom; when the NIS is not finite, nothing has changed.
    """
    informative = linearise(sensor, belief, work.slots[:count], work.observation, work.innovation, work.jacobian)
    if not are_sound(sensor, work.observation[:count], work.observation_cov[:count]):
        return math.nan, informative
    size, dx, block_dx = belief.size, work.scratch[CORRECTION], work.scratch[BLOCK_CORRECTION]
    dx[:size] = 0.0
    nis, block = 0.0, len(work.W) // 2
    waiting, waited = work.waiting, work.waiting.used[0]
    is_late = count <= block and may_wait(waiting, 2 * count, size)
    before = _kept(belief, count, block, work)
    for first in range(0, count, block):
        last = min(first + block, count)
        subtract_projection(dx, first, last, work)
        nis += whiten(belief, first, last, work)
        rows = 2 * (last - first)
        if math.isfinite(nis) and are_variances_lost(belief.cov, work.slots[first:last], work.W, rows):
            nis = EXHAUSTED
        if not math.isfinite(nis):
            if first > 0:
                belief.cov[:size, :size] = before
                waiting.used[0] = waited
            return nis, informative
        combine_rows(work.W, work.innovation[2 * first :], block_dx, rows, size)
        for j in range(size):
            dx[j] += block_dx[j]
        if is_late:
            postpone(belief.cov, size, waiting, work.W[:rows], work.W[:rows])
        else:
            settle(belief.cov, size, waiting)
            subtract_gram(belief.cov, work.W, rows, size)
            mirror_robot_block(belief.cov)
    return nis, informative


@kernel
def _kept(belief: Belief, count: int, block: int, work: Workspace) -> Float:
    """A copy of P if a block after the first might be refused, else nothing.

    No variance shrinks to less than 1 / (1 + tr(R^-1 H P H')) of itself by a scan, no pivot of S is smaller than R's,
    and (H P H')_aa is at most five times the sum of h^2 P: if that is far from exhausting precision, all goes well.
    """
    information = 0.0
    for i in range(count if count > block else 0):
        R, landmark = work.observation_cov[i], ROBOT + 2 * work.slots[i]
        determinant = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        least = determinant / (R[0, 0] + R[1, 1])  # at most the smallest eigenvalue
        information += R[0, 0] * R[1, 1] / determinant  # a pivot of R is of that share of its variance at least
        for k in (2 * i, 2 * i + 1):
            h = work.jacobian[k]
            entered = h[0] * h[0] * belief.cov[0, 0] + h[1] * h[1] * belief.cov[1, 1] + h[2] * h[2] * belief.cov[2, 2]
            entered += h[3] * h[3] * belief.cov[landmark, landmark]
            entered += h[4] * h[4] * belief.cov[landmark + 1, landmark + 1]
            information += 5.0 * entered / least
    needed = 0 if 0.0 <= information < SAFE / LEAST else belief.size
    return belief.cov[:needed, :needed].copy()


@kernel
def are_sound(sensor: int, values: Float, covs: Float) -> bool:
    """Whether observations (m, 2) are of a size to go on with, ranges not negative, covariances positive definite."""
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
