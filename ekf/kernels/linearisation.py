"""Innovations and Jacobians of a scan, compiled."""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.compiled import kernel
from slamgauge.ekf.kernels.covariance import projected
from slamgauge.ekf.kernels.models import observe, wrap_innovation
from slamgauge.ekf.kernels.workspace import Workspace


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
def subtract_projection(dx: Float, first: int, last: int, work: Workspace) -> None:
    """Subtract H dx from the innovations of observations first..last."""
    for i in range(first, last):
        landmark = 3 + 2 * work.slots[i]
        for k in (2 * i, 2 * i + 1):
            h = work.jacobian[k]
            work.innovation[k] -= h[0] * dx[0] + h[1] * dx[1] + h[2] * dx[2]
            work.innovation[k] -= h[3] * dx[landmark] + h[4] * dx[landmark + 1]
