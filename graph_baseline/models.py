"""The measurements' exact models, compiled: the noise of a step, an observation's residual, and their Jacobians."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compiled import inner
from slamgauge.graph_baseline.factors import prior_cov_in_body
from slamgauge.graph_baseline.linearisation import inverse_cholesky
from slamgauge.recording import Recording

RANGE_BEARING, POSITION, BEARING = range(3)
SENSORS = {"range-bearing": RANGE_BEARING, "position": POSITION, "bearing": BEARING}


class Measured(NamedTuple):
    """A recording as the kernels take it; `slot` is -1 for an observation that is not taken in yet."""

    sensor: int
    start: Float  # (3,) prior mean
    motion: Float  # (N+1, 3) increment that leads to pose k; 0 for the first
    motion_cov: Float  # (N+1, 3, 3) in the body frame; the prior's for the first
    first: Int  # (N+2,) row of pose k's first observation
    value: Float  # (M, d)
    whitener: Float  # (M, d, d) lower triangular L^-1 of the covariance L L'
    slot: Int  # (M,)


def measured_of(recording: Recording) -> Measured:
    """The recording as kernels take it; no observation has a slot yet.

    Every array is laid out row by row, whatever the recording's are: the kernels are compiled for that alone.
    """
    return Measured(
        sensor=SENSORS[recording.sensor],
        start=np.array(recording.prior_mean, dtype=np.float64),
        motion=np.concatenate([np.zeros((1, 3)), recording.odometry]),
        motion_cov=np.ascontiguousarray(np.concatenate([prior_cov_in_body(recording)[None], recording.odometry_cov])),
        first=np.searchsorted(recording.observation_step, np.arange(recording.steps + 2)),
        value=np.ascontiguousarray(recording.observation, dtype=np.float64),
        whitener=np.ascontiguousarray(inverse_cholesky(recording.observation_cov)),
        slot=np.full(len(recording.observation), -1),
    )


@inner
def log_se2(x: float, y: float, t: float) -> tuple[float, float]:
    """Translation of the logarithm of the increment (x, y, t) of SE(2)."""
    half = 0.5 * t
    cotangent = 1.0 - half * half / 3.0 if abs(half) < 1e-4 else half / math.tan(half)
    return cotangent * x + half * y, cotangent * y - half * x


@inner
def wrap(angle: float) -> float:
    """The angle [rad] in [-pi, pi]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@inner
def step_noise(start: Float, motion: Float, end: Float, w: Float, B: Float) -> None:
    """The noise w (3,) of a step from pose `start` to `end` in the world, and B (3, 3), its Jacobian by the residual.

    The residual is Log(measured^-1 between) ~ N(0, Q), and B is R(end) times SE(2)'s right Jacobian.
    """
    c, s = math.cos(start[2]), math.sin(start[2])
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = c * dx + s * dy - motion[0], c * dy - s * dx - motion[1]
    turn = wrap(end[2] - start[2] - motion[2])
    c, s = math.cos(motion[2]), math.sin(motion[2])
    rx, ry = log_se2(c * x + s * y, c * y - s * x, turn)
    c, s = math.cos(end[2]), math.sin(end[2])
    w[0], w[1], w[2] = c * rx - s * ry, s * rx + c * ry, turn
    if abs(turn) < 1e-2:
        sine = 1.0 - turn * turn / 6.0 + turn**4 / 120.0
        versine = 0.5 * turn - turn**3 / 24.0
        b = 0.5 - turn * turn / 24.0
        a = turn / 6.0 - turn**3 / 120.0
    else:
        sine, versine = math.sin(turn) / turn, 2.0 * math.sin(0.5 * turn) ** 2 / turn
        b, a = versine / turn, (turn - math.sin(turn)) / (turn * turn)
    j02, j12 = a * rx - b * ry, b * rx + a * ry
    B[0, 0], B[0, 1], B[0, 2] = c * sine + s * versine, c * versine - s * sine, c * j02 - s * j12
    B[1, 0], B[1, 1], B[1, 2] = s * sine - c * versine, s * versine + c * sine, s * j02 + c * j12
    B[2, 0], B[2, 1], B[2, 2] = 0.0, 0.0, 1.0


@inner
def observe(measured: Measured, row: int, pose: Float, m: Float, r: Float, Hx: Float, Hm: Float) -> None:
    """Whitened residual h - z (d,) and Jacobians (d, 3), (d, 2) of an observation of the landmark m from a pose."""
    ex, ey = m[0] - pose[0], m[1] - pose[1]
    z, whitener = measured.value[row], measured.whitener[row]
    r0, r1, a00, a01, a10, a11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # residuals, and their gradients by m
    if measured.sensor == POSITION:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        r0, r1, a00, a01, a10, a11 = c * ex + s * ey - z[0], c * ey - s * ex - z[1], c, s, -s, c
    else:
        squared = ex * ex + ey * ey
        bearing = math.atan2(ey, ex) - pose[2]
        across_x, across_y = -ey / squared, ex / squared
        if measured.sensor == BEARING:
            r0, a00, a01 = wrap(bearing - z[0]), across_x, across_y
        else:
            distance = math.sqrt(squared)
            r0, r1 = distance - z[0], wrap(bearing - z[1])
            a00, a01, a10, a11 = ex / distance, ey / distance, across_x, across_y
    for i in range(len(z)):
        w0 = whitener[i, 0]
        w1 = whitener[i, 1] if i == 1 else 0.0
        r[i] = w0 * r0 + w1 * r1
        Hm[i, 0], Hm[i, 1] = w0 * a00 + w1 * a10, w0 * a01 + w1 * a11
        Hx[i, 0], Hx[i, 1] = -Hm[i, 0], -Hm[i, 1]
        Hx[i, 2] = Hm[i, 0] * ey - Hm[i, 1] * ex
