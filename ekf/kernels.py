"""The steps of landmark EKF-SLAM on a preallocated state, compiled.

State vector: robot (x, y, heading), then two world coordinates per mapped landmark; `size` entries of
`state` and of the square `cov` are in use. Landmark in slot i starts at entry 3 + 2 i. Of `cov` only
the upper triangle is kept, and the robot's own 3 x 3 block is kept whole. Covariances are those of the
additive error in the world frame, for every filter.

Jacobians are taken at `point`, laid out like `state`: the state itself (the same array), or, for the
first-estimates filter, each landmark's first position and the robot's last predicted pose.

Source: the practical, equations 1.1; Sola, "Simultaneous localization and mapping with the extended
Kalman filter" (2014) for the block structure.
"""

from __future__ import annotations

import math

import numpy as np

from ekf.compiled import cholesky, combine_rows, kernel, solve_factor, subtract_gram
from ekf.models import locate, observe, wrap, wrap_innovation
from ekf.workspace import Workspace
from slam2d import Float, Int

TILE = 64  # rows of `cov` that a strided pass keeps in cache


@kernel
def predict(state: Float, point: Float, cov: Float, size: int, increment: Float, increment_cov: Float) -> bool:
    """Move the robot by a body-frame increment: P_rr <- F P_rr F' + G Q G', P_rm <- F P_rm.

    F = [I, J lever; 0, 1], where the lever reaches from `point`'s robot to the new position. `point` then
    takes the predicted pose. Returns False, with nothing changed, when a number is not finite.
    """
    if not math.isfinite(increment.sum() + increment_cov.sum()):
        return False
    c, s = math.cos(state[2]), math.sin(state[2])
    moved_x = c * increment[0] - s * increment[1]
    moved_y = s * increment[0] + c * increment[1]
    lever_x = moved_x + (state[0] - point[0])
    lever_y = moved_y + (state[1] - point[1])
    state[0] += moved_x
    state[1] += moved_y
    state[2] = wrap(state[2] + increment[2])
    point[:3] = state[:3]
    # the heading's row leaks into the position's rows
    for j in range(2, size):
        cov[0, j] -= lever_y * cov[2, j]
        cov[1, j] += lever_x * cov[2, j]
    cov[0, 0] -= lever_y * (cov[2, 0] + cov[0, 2])
    cov[0, 1] += lever_x * cov[0, 2] - lever_y * cov[2, 1]
    cov[1, 1] += lever_x * (cov[2, 1] + cov[1, 2])
    _add_increment_noise(cov, c, s, increment_cov)
    return True


@kernel
def _add_increment_noise(cov: Float, c: float, s: float, Q: Float) -> None:
    """Add G Q G' with G = blkdiag(R(heading), 1) to the robot's block, and mirror that block."""
    qx0, qx1, qx2 = c * Q[0, 0] - s * Q[1, 0], c * Q[0, 1] - s * Q[1, 1], c * Q[0, 2] - s * Q[1, 2]
    qy0, qy1, qy2 = s * Q[0, 0] + c * Q[1, 0], s * Q[0, 1] + c * Q[1, 1], s * Q[0, 2] + c * Q[1, 2]
    cov[0, 0] += qx0 * c - qx1 * s
    cov[0, 1] += qx0 * s + qx1 * c
    cov[1, 1] += qy0 * s + qy1 * c
    cov[0, 2] += qx2
    cov[1, 2] += qy2
    cov[2, 2] += Q[2, 2]
    mirror_robot_block(cov)


@kernel
def mirror_robot_block(cov: Float) -> None:
    """Copy the upper triangle of the robot's block to its lower triangle."""
    cov[1, 0] = cov[0, 1]
    cov[2, 0] = cov[0, 2]
    cov[2, 1] = cov[1, 2]


@kernel
def linearise(
    sensor: int, state: Float, point: Float, slots: Int, observation: Float, innovation: Float, jacobian: Float
) -> int:
    """Innovations (2m,) at `state` and compact Jacobians (2m, 5) at `point`.

    Columns: robot x, y, heading, landmark x, y; H = A R(heading)' [-I, -J (l - p), I]. Returns the number
    of rows that carry information.
    """
    c, s = math.cos(point[2]), math.sin(point[2])
    c_now, s_now = math.cos(state[2]), math.sin(state[2])
    informative = 0
    for i in range(len(slots)):
        landmark = 3 + 2 * slots[i]
        ex, ey = state[landmark] - state[0], state[landmark + 1] - state[1]
        z0, z1, _, _, _, _ = observe(sensor, c_now * ex + s_now * ey, c_now * ey - s_now * ex)
        ex, ey = point[landmark] - point[0], point[landmark + 1] - point[1]
        _, _, a00, a01, a10, a11 = observe(sensor, c * ex + s * ey, c * ey - s * ex)
        for row, predicted, ax, ay in ((0, z0, a00, a01), (1, z1, a10, a11)):
            k = 2 * i + row
            hx, hy = ax * c - ay * s, ax * s + ay * c
            jacobian[k, 0] = -hx
            jacobian[k, 1] = -hy
            jacobian[k, 2] = hx * ey - hy * ex
            jacobian[k, 3] = hx
            jacobian[k, 4] = hy
            if hx == 0.0 and hy == 0.0:
                innovation[k] = 0.0
            else:
                innovation[k] = wrap_innovation(sensor, row, observation[i, row] - predicted)
                informative += 1
    return informative


@kernel
def project_covariance(cov: Float, size: int, slots: Int, jacobian: Float, W: Float) -> None:
    """W[:2m, :size] = H P from the upper triangle of P."""
    for i in range(len(slots)):
        for k in (2 * i, 2 * i + 1):
            h0, h1, h2 = jacobian[k, 0], jacobian[k, 1], jacobian[k, 2]
            for j in range(size):
                W[k, j] = h0 * cov[0, j] + h1 * cov[1, j] + h2 * cov[2, j]
    for first in range(0, size, TILE):
        last = min(first + TILE, size)
        for i in range(len(slots)):
            _project_landmark(cov, first, last, 3 + 2 * slots[i], 2 * i, jacobian, W)


@kernel
def _project_landmark(cov: Float, first: int, last: int, landmark: int, k: int, jacobian: Float, W: Float) -> None:
    """Add the landmark's share of H P to columns first..last of W's rows k and k + 1."""
    a3, a4, b3, b4 = jacobian[k, 3], jacobian[k, 4], jacobian[k + 1, 3], jacobian[k + 1, 4]
    above = min(last, landmark)
    for j in range(first, above):
        px, py = cov[j, landmark], cov[j, landmark + 1]
        W[k, j] += a3 * px + a4 * py
        W[k + 1, j] += b3 * px + b4 * py
    for j in range(max(first, landmark), last):
        px = cov[landmark, j]
        py = cov[min(j, landmark + 1), max(j, landmark + 1)]
        W[k, j] += a3 * px + a4 * py
        W[k + 1, j] += b3 * px + b4 * py


@kernel
def innovation_covariance(W: Float, slots: Int, jacobian: Float, observation_cov: Float, S: Float) -> None:
    """Upper triangle of S = H P H' + R from W = H P."""
    rows = 2 * len(slots)
    for a in range(rows):
        for b in range(a, rows):
            column = 3 + 2 * slots[b // 2]
            S[a, b] = (
                W[a, 0] * jacobian[b, 0]
                + W[a, 1] * jacobian[b, 1]
                + W[a, 2] * jacobian[b, 2]
                + W[a, column] * jacobian[b, 3]
                + W[a, column + 1] * jacobian[b, 4]
            )
    for i in range(len(slots)):
        k = 2 * i
        S[k, k] += observation_cov[i, 0, 0]
        S[k + 1, k + 1] += observation_cov[i, 1, 1]
        if jacobian[k + 1, 3] != 0.0 or jacobian[k + 1, 4] != 0.0:  # else row k + 1 was skipped
            S[k, k + 1] += observation_cov[i, 0, 1]


@kernel
def projected(cov: Float, h: Float, landmark: int) -> tuple[float, float, float]:
    """H P H' of one observation, from the upper triangle of P."""
    block = np.empty((5, 5))
    for a in range(3):
        for b in range(3):
            block[a, b] = cov[a, b]
        for b in range(2):
            block[a, 3 + b] = block[3 + b, a] = cov[a, landmark + b]
    block[3, 3], block[4, 4] = cov[landmark, landmark], cov[landmark + 1, landmark + 1]
    block[3, 4] = block[4, 3] = cov[landmark, landmark + 1]
    s00, s01, s11 = 0.0, 0.0, 0.0
    for a in range(5):
        for b in range(5):
            s00 += h[0, a] * block[a, b] * h[0, b]
            s01 += h[0, a] * block[a, b] * h[1, b]
            s11 += h[1, a] * block[a, b] * h[1, b]
    return s00, s01, s11


@kernel
def squared_distance(v0: float, v1: float, s00: float, s01: float, s11: float) -> float:
    """Squared Mahalanobis distance v' S^-1 v; infinite where S is not positive definite."""
    determinant = s00 * s11 - s01 * s01
    if not determinant > 0.0:
        return math.inf
    return (v0 * v0 * s11 - 2.0 * v0 * v1 * s01 + v1 * v1 * s00) / determinant


@kernel
def describe(sensor: int, state: Float, point: Float, cov: Float, count: int, work: Workspace, S: Float) -> None:
    """Innovations and Jacobians of the first `count` observations in `work`, and each one's covariance S (m, 2, 2)."""
    linearise(sensor, state, point, work.slots[:count], work.observation, work.innovation, work.jacobian)
    for i in range(count):
        h, R = work.jacobian[2 * i : 2 * i + 2], work.observation_cov[i]
        s00, s01, s11 = projected(cov, h, 3 + 2 * work.slots[i])
        if h[1, 3] != 0.0 or h[1, 4] != 0.0:
            s01 += R[0, 1]
        S[i, 0, 0], S[i, 1, 1] = s00 + R[0, 0], s11 + R[1, 1]
        S[i, 0, 1] = S[i, 1, 0] = s01


@kernel
def whiten(cov: Float, size: int, first: int, last: int, work: Workspace) -> float:
    """Prepare to take in observations first..last, which `linearise` has described in `work`.

    Leaves W = U'^-1 H P and the whitened innovation y = U'^-1 v in `work` (y in its own rows), where S = U'U,
    so that the correction is W'y and the covariance decreases by W'W. Returns the NIS, which is not finite
    when S is not positive definite or an observation is not finite.
    """
    rows = 2 * (last - first)
    slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
    W, S, y = work.W, work.S, work.innovation[2 * first : 2 * last]
    project_covariance(cov, size, slots, jacobian, W)
    innovation_covariance(W, slots, jacobian, work.observation_cov[first:last], S)
    return divide_by_factor(S, W, y, rows, size)


@kernel
def divide_by_factor(S: Float, W: Float, y: Float, rows: int, size: int) -> float:
    """W <- U'^-1 W and y <- U'^-1 y, where S = U'U; returns y'y, NaN when S is not positive definite."""
    if not cholesky(S, rows):
        return math.nan
    solve_factor(S, W, rows, size)
    squared = 0.0
    for a in range(rows):
        for b in range(a):
            y[a] -= S[b, a] * y[b]
        y[a] /= S[a, a]
        squared += y[a] * y[a]
    return squared


@kernel
def take_in(
    sensor: int, state: Float, point: Float, cov: Float, size: int, count: int, work: Workspace
) -> tuple[float, int]:
    """P <- P - W'W for the first `count` observations, and their correction dx in `work.scratch[0]`.

    Block by block of the workspace, all with the Jacobians at `point`: for independent observations that is
    the same as all at once, and saves the triangular solve that grows with the square of a block. Returns the
    NIS and its degrees of freedom; when the NIS is not finite, nothing has changed, unless P itself was not
    positive definite.
    """
    informative = linearise(sensor, state, point, work.slots[:count], work.observation, work.innovation, work.jacobian)
    if not are_sound(work.observation[:count], work.observation_cov[:count]):
        return math.nan, informative
    dx, block_dx = work.scratch[0], work.scratch[1]
    dx[:size] = 0.0
    nis, block = 0.0, len(work.W) // 2
    for first in range(0, count, block):
        last = min(first + block, count)
        subtract_projection(dx, first, last, work)
        nis += whiten(cov, size, first, last, work)
        if not math.isfinite(nis):
            return math.nan, informative
        rows = 2 * (last - first)
        combine_rows(work.W, work.innovation[2 * first :], block_dx, rows, size)
        for j in range(size):
            dx[j] += block_dx[j]
        subtract_gram(cov, work.W, rows, size)
        mirror_robot_block(cov)
    return nis, informative


@kernel
def are_sound(values: Float, covs: Float) -> bool:
    """Whether observations (m, 2) are finite and their covariances (m, 2, 2) positive definite."""
    for i in range(len(values)):
        R = covs[i]
        if not math.isfinite(values[i, 0] + values[i, 1]):
            return False
        if not (R[0, 0] > 0.0 and R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0] > 0.0 and math.isfinite(R[0, 0] + R[1, 1])):
            return False
    return True


@kernel
def subtract_projection(dx: Float, first: int, last: int, work: Workspace) -> None:
    """Subtract H dx from the innovations of observations first..last."""
    for i in range(first, last):
        landmark = 3 + 2 * work.slots[i]
        for k in (2 * i, 2 * i + 1):
            h = work.jacobian[k]
            work.innovation[k] -= h[0] * dx[0] + h[1] * dx[1] + h[2] * dx[2]
            work.innovation[k] -= h[3] * dx[landmark] + h[4] * dx[landmark + 1]


@kernel
def find_slots(sorted_ids: Int, sorted_slots: Int, ids: Int, slots: Int) -> int:
    """Slot of each id by bisection, -1 for ids that are not mapped; returns how many are not."""
    unmapped = 0
    for i in range(len(ids)):
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
            slots[i] = -1
            unmapped += 1
    return unmapped


@kernel
def augment(sensor: int, state: Float, point: Float, cov: Float, size: int, count: int, work: Workspace) -> None:
    """Append the landmarks of the first `count` observations in `work`, in their order."""
    for i in range(count):
        append_landmark(sensor, state, point, cov, size + 2 * i, work.observation[i], work.observation_cov[i])


@kernel
def append_landmark(sensor: int, state: Float, point: Float, cov: Float, size: int, z: Float, R: Float) -> None:
    """Append a landmark seen at z: P_l. = J_r P_r., P_ll = J_r P_rr J_r' + J_z R J_z'.

    J_r = [I, J lever], where the lever reaches from `point`'s robot to the landmark.
    """
    c, s = math.cos(state[2]), math.sin(state[2])
    dx, dy, b00, b01, b10, b11 = locate(sensor, z[0], z[1])
    ex, ey = c * dx - s * dy, s * dx + c * dy
    x, y = size, size + 1
    state[x] = state[0] + ex
    state[y] = state[1] + ey
    point[x], point[y] = state[x], state[y]
    ex += state[0] - point[0]
    ey += state[1] - point[1]
    for j in range(size):
        cov[j, x] = cov[0, j] - ey * cov[2, j]
        cov[j, y] = cov[1, j] + ex * cov[2, j]
    jx0, jx1, jy0, jy1 = c * b00 - s * b10, c * b01 - s * b11, s * b00 + c * b10, s * b01 + c * b11
    rx0, rx1 = jx0 * R[0, 0] + jx1 * R[1, 0], jx0 * R[0, 1] + jx1 * R[1, 1]
    ry0, ry1 = jy0 * R[0, 0] + jy1 * R[1, 0], jy0 * R[0, 1] + jy1 * R[1, 1]
    cov[x, x] = cov[0, x] - ey * cov[2, x] + rx0 * jx0 + rx1 * jx1
    cov[x, y] = cov[0, y] - ey * cov[2, y] + rx0 * jy0 + rx1 * jy1
    cov[y, y] = cov[1, y] + ex * cov[2, y] + ry0 * jy0 + ry1 * jy1
