"""Augmentation: append new landmarks to the state, compiled."""

from __future__ import annotations

import math

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief, resized
from slamgauge.formula_kernels import locate
from slamgauge.jit import inner, kernel


@kernel
def augment(sensor: int, belief: Belief, values: Float, covs: Float) -> None:
    """Append the landmarks of observations (m, 2) with covariances (m, 2, 2), in this order.

    The caller then increases the size of the belief.
    """
    for i in range(len(values)):
        longer = resized(belief, belief.size + 2 * i)
        append_landmark(sensor, longer, belief.point, values[i], covs[i])


@inner
def append_landmark(sensor: int, belief: Belief, point: Float, z: Float, R: Float) -> None:
    """Append a landmark observed at z: P_l. = J_r P_r., P_ll = J_r P_rr J_r' + J_z R J_z'.

    J_r = [I, J lever]; the lever is the vector from the robot's position in `point` to the landmark. The caller then
    increases the size of the belief.
    """
    state, cov, size = belief.state, belief.cov, belief.size
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
