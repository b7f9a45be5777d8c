"""Innovations and Jacobians of a scan, compiled."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT, Belief
from slamgauge.ekf.kernels.covariance import own_covariance
from slamgauge.formula_kernels import observe, wrap_innovation
from slamgauge.jit import inner, kernel

PROJECTED = 1  # form of Jacobians (`Belief.form`): evaluated at the belief's state, then projected


@inner
def linearise(sensor: int, belief: Belief, slots: Int, observation: Float, innovation: Float, jacobian: Float) -> int:
    """Fill `innovation` (2m,) and the compact `jacobian` (2m, 5) of observations (m, 2).

    The innovation is taken at the belief's state. Columns of the Jacobian: robot x, y, heading, landmark x, y;
    H = A R(heading)' [-I, -J (l - p), I], evaluated at the belief's `point`, or at its state and then projected (see
    `project_on_observable`). Returns the number of rows with information.
    """
    state = belief.state
    at = state if belief.form == PROJECTED else belief.point
    c, s = math.cos(at[2]), math.sin(at[2])
    c_now, s_now = math.cos(state[2]), math.sin(state[2])
    informative = 0
    for i in range(len(slots)):
        landmark = 3 + 2 * slots[i]
        ex, ey = state[landmark] - state[0], state[landmark + 1] - state[1]
        z0, z1, _, _, _, _ = observe(sensor, c_now * ex + s_now * ey, c_now * ey - s_now * ex)
        ex, ey = at[landmark] - at[0], at[landmark + 1] - at[1]
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
            if belief.form == PROJECTED:
                project_on_observable(belief.point, landmark, jacobian[k])
    return informative


@inner
def project_on_observable(point: Float, landmark: int, h: Float) -> None:
    """Replace h (5,) by the nearest row (Euclidean norm) with h N = 0: translation and rotation stay unobservable.

    N = [I, J p; 0, 1; I, J l] at `point`, which the first-estimates prediction propagates from step to step. For a
    rotation about the midpoint of p and l, the third column n = [-J d / 2; 1; J d / 2], d = l - p, is orthogonal to the
    other two columns. Every h is already orthogonal to those two: h <- h - (h n) n' / (n' n).
    """
    dx, dy = point[landmark] - point[0], point[landmark + 1] - point[1]
    nx, ny = -0.5 * dy, 0.5 * dx
    along = h[2] + nx * (h[3] - h[0]) + ny * (h[4] - h[1])
    excess = along / (1.0 + 2.0 * (nx * nx + ny * ny))
    h[0] += excess * nx
    h[1] += excess * ny
    h[2] -= excess
    h[3] -= excess * nx
    h[4] -= excess * ny


@kernel
def innovations_of(
    sensor: int, belief: Belief, slots: Int, observation: Float, noise_cov: Float
) -> tuple[Float, Float]:
    """Return the innovations (2m,) of observations (m, 2), and the innovation covariance S (m, 2, 2) of each.

    The landmark of each observation is in `slots` (m,); `noise_cov` is (m, 2, 2).
    """
    count = len(slots)
    innovation, jacobian, S = np.empty(2 * count), np.empty((2 * count, 5)), np.empty((count, 2, 2))
    linearise(sensor, belief, slots, observation, innovation, jacobian)
    for i in range(count):
        h = jacobian[2 * i : 2 * i + 2]
        s00, s01, s11 = own_covariance(belief.cov, h, ROBOT + 2 * slots[i], noise_cov[i])
        S[i, 0, 0], S[i, 1, 1] = s00, s11
        S[i, 0, 1] = S[i, 1, 0] = s01
    return innovation, S


@inner
def subtract_projection(dx: Float, slots: Int, jacobian: Float, innovation: Float) -> None:
    """Subtract H dx from innovations (2m,) of the landmarks in `slots` (m,)."""
    for k in range(2 * len(slots)):
        h, landmark = jacobian[k], 3 + 2 * slots[k // 2]
        innovation[k] -= h[0] * dx[0] + h[1] * dx[1] + h[2] * dx[2]
        innovation[k] -= h[3] * dx[landmark] + h[4] * dx[landmark + 1]
