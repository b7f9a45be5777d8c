"""The update that all corrections share: gain of a scan and updated covariance, compiled.

The gain K = P H' S^-1 is never formed. With S = U'U, W = U'^-1 H P and y = U'^-1 v, the correction is K v = W'y and the
covariance decreases by K S K' = W'W.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import ROBOT, Belief
from slamgauge.ekf.kernels.blas import cholesky, combine_rows, solve_factor, subtract_gram
from slamgauge.ekf.kernels.covariance import innovation_covariance, is_symmetric, mirror_robot_block, project_covariance
from slamgauge.ekf.kernels.deferred_downdate import apply_deferred, defer, may_defer, subtract_deferred
from slamgauge.ekf.kernels.linearisation import Linearised, linearise_scan, subtract_projection
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LARGEST, LEAST, are_pivots_lost, are_variances_lost
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import inner, kernel
from slamgauge.sensor_kernels import HAS_RANGE

SAFE = 1e-3  # share of the information that would exhaust double precision; below it, no backup of P is needed


class Gain(NamedTuple):
    """The gain of m observations in factored form."""

    U: Float  # upper triangular factor of S = U'U in its first 2m rows and columns
    W: Float  # (2m, capacity) U'^-1 H P in its first `size` columns
    y: Float  # (2m,) whitened innovation U'^-1 v
    nis: float  # y'y; not finite if no update exists


class JointUpdate(NamedTuple):
    """Result of `joint_update`."""

    dx: Float  # (size,) correction of the state
    nis: float  # not finite if no update exists
    dof: int  # degrees of freedom of the NIS


@inner
def joint_update(sensor: int, belief: Belief, count: int, work: Workspace) -> JointUpdate:
    """P <- P - W'W for the first `count` observations of `work`; return the correction dx of the state.

    The state is not changed. The observations are processed in blocks of the workspace, all with Jacobians at the same
    point. The result is that of a single block, because observations are independent, but the triangular solve is
    cheaper: its cost grows with the square of the block. The downdate may be deferred (see `deferred_downdate`). If the
    NIS is not finite, the belief is unchanged.
    """
    scan, informative = linearise_scan(sensor, belief, count, work)
    size, block, deferred = belief.size, len(work.W) // 2, work.deferred
    dx, block_dx = np.zeros(size), np.empty(size)
    nis = 0.0
    if not are_sound(sensor, work.observation[:count], scan.noise_cov):
        return JointUpdate(dx, math.nan, informative)
    is_deferred = count <= block and may_defer(deferred, 2 * count, size)
    used_before, cov_before = deferred.used[0], _backup(belief, scan, block)
    for first in range(0, count, block):
        last = min(first + block, count)
        subtract_projection(dx, scan, first, last)
        gain = whiten(belief, scan, first, last, work)
        rows = 2 * (last - first)
        nis += gain.nis
        if math.isfinite(nis) and are_variances_lost(belief.cov, scan.slots[first:last], gain.W, rows):
            nis = EXHAUSTED
        if not math.isfinite(nis):
            if first > 0:
                _restore(belief.cov, cov_before)
                deferred.used[0] = used_before
            return JointUpdate(dx, nis, informative)
        combine_rows(gain.W, gain.y, block_dx, rows, size)
        for j in range(size):
            dx[j] += block_dx[j]
        if is_deferred:
            defer(belief.cov, size, deferred, gain.W, gain.W)
        else:
            apply_deferred(belief.cov, size, deferred)
            subtract_gram(belief.cov, gain.W, rows, size)
            mirror_robot_block(belief.cov)
    return JointUpdate(dx, nis, informative)


@inner
def whiten(belief: Belief, scan: Linearised, first: int, last: int, work: Workspace) -> Gain:
    """Return the gain of observations first..last of a scan, computed in the arrays W and S of `work`.

    Overwrites their innovations with y. The NIS is not finite if S is not positive definite, if a pivot of S is only
    rounding (`EXHAUSTED`), or if an observation is not finite.
    """
    rows = 2 * (last - first)
    slots, jacobian = scan.slots[first:last], scan.jacobian[2 * first : 2 * last]
    W, S, y = work.W[:rows], work.S, scan.innovation[2 * first : 2 * last]
    project_covariance(belief.cov, belief.size, slots, jacobian, W)
    if work.deferred.used[0] > 0:
        subtract_deferred(work.deferred, belief.size, slots, jacobian, W)
    innovation_covariance(W, slots, jacobian, scan.noise_cov[first:last], S)
    nis = divide_by_factor(S, W, y, rows, belief.size)
    if math.isfinite(nis) and are_pivots_lost(S, belief.cov, slots, jacobian):
        nis = EXHAUSTED
    return Gain(S, W, y, nis)


@inner
def divide_by_factor(S: Float, W: Float, y: Float, rows: int, size: int) -> float:
    """Factor S = U'U, S <- U, W <- U'^-1 W and y <- U'^-1 y; return y'y.

    The result is NaN if S is not positive definite, and `EXHAUSTED` if a pivot is only rounding of its variance.
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


@inner
def _backup(belief: Belief, scan: Linearised, block: int) -> Float:
    """Return a copy of P if a block after the first might exhaust double precision, else an empty array.

    A scan reduces no variance to less than 1 / (1 + tr(R^-1 H P H')) of its value, no pivot of S is smaller than the
    same pivot of R, and (H P H')_aa is at most five times the sum of h^2 P. If these bounds are far from exhausting
    double precision, every block has an update.
    """
    information, count = 0.0, len(scan.slots)
    for i in range(count if count > block else 0):
        R, landmark = scan.noise_cov[i], ROBOT + 2 * scan.slots[i]
        determinant = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        least = determinant / (R[0, 0] + R[1, 1])  # at most the smallest eigenvalue
        information += R[0, 0] * R[1, 1] / determinant  # a pivot of R is at least this share of its variance
        for k in (2 * i, 2 * i + 1):
            h = scan.jacobian[k]
            entered = h[0] * h[0] * belief.cov[0, 0] + h[1] * h[1] * belief.cov[1, 1] + h[2] * h[2] * belief.cov[2, 2]
            entered += h[3] * h[3] * belief.cov[landmark, landmark]
            entered += h[4] * h[4] * belief.cov[landmark + 1, landmark + 1]
            information += 5.0 * entered / least
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
