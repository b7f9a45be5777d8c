"""The measurements' exact models, compiled: residuals of steps and of observations, and their Jacobians."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import inverse_cholesky
from slamgauge.graph_baseline.problem.preparation import prior_cov_in_body
from slamgauge.jit import inner
from slamgauge.recording import Recording

RANGE_BEARING, POSITION, BEARING = range(3)
SENSORS = {"range-bearing": RANGE_BEARING, "position": POSITION, "bearing": BEARING}


class Measured(NamedTuple):
    """A recording as the kernels take it; `slot` is -1 for an observation that is not taken in yet."""

    sensor: int
    start: Float  # (3,) prior mean
    motion: Float  # (N+1, 3) increment that leads to pose k; 0 for the first
    motion_turn: Float  # (N+1, 2) cosine and sine of its turn
    motion_cov: Float  # (N+1, 3, 3) in the body frame; the prior's for the first
    first: Int  # (N+2,) row of pose k's first observation
    value: Float  # (M, d)
    direction: Float  # (M, 2) cosine and sine of the bearing, (1, 0) of a position
    whitener: Float  # (M, d, d) lower triangular L^-1 of the covariance L L'
    slot: Int  # (M,)


class Sight(NamedTuple):
    """One observation, in numbers: an array handed on to a kernel costs more than `observe` does."""

    z0: float
    z1: float
    cosine: float  # of the bearing
    sine: float
    w00: float  # of the whitener
    w10: float
    w11: float


def measured_of(recording: Recording) -> Measured:
    """The recording as kernels take it; no observation has a slot yet.

    Every array is laid out row by row, whatever the recording's are: the kernels are compiled for that alone.
    """
    motion = np.concatenate([np.zeros((1, 3)), recording.odometry])
    bearing = np.zeros(len(recording.observation)) if recording.sensor == "position" else recording.observation[:, -1]
    return Measured(
        sensor=SENSORS[recording.sensor],
        start=np.array(recording.prior_mean, dtype=np.float64),
        motion=motion,
        motion_turn=np.column_stack([np.cos(motion[:, 2]), np.sin(motion[:, 2])]),
        motion_cov=np.ascontiguousarray(np.concatenate([prior_cov_in_body(recording)[None], recording.odometry_cov])),
        first=np.searchsorted(recording.observation_step, np.arange(recording.steps + 2)),
        value=np.ascontiguousarray(recording.observation, dtype=np.float64),
        direction=np.column_stack([np.cos(bearing), np.sin(bearing)]),
        whitener=np.ascontiguousarray(inverse_cholesky(recording.observation_cov)),
        slot=np.full(len(recording.observation), -1),
    )


@inner
def facing(pose: Float) -> tuple[float, float]:
    """Cosine and sine of the heading."""
    return math.cos(pose[2]), math.sin(pose[2])


@inner
def log_se2(x: float, y: float, t: float) -> tuple[float, float]:
    """Translation of the logarithm of the increment (x, y, t) of SE(2)."""
    half = 0.5 * t
    if abs(half) < 0.05:
        q = half * half
        cotangent = 1.0 - q / 3.0 * (1.0 + q / 15.0 * (1.0 + q * 2.0 / 21.0 * (1.0 + q / 10.0)))
    else:
        cotangent = half / math.tan(half)
    return cotangent * x + half * y, cotangent * y - half * x


@inner
def wrap(angle: float) -> float:
    """The angle [rad] in [-pi, pi]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@inner
def angle_of(along: float, across: float) -> float:
    """The angle [rad] of the vector (along, across); where it is small a series spares the call of `atan2`."""
    if abs(across) < 0.05 * along:
        t = across / along
        q = t * t
        return t * (1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * (1.0 / 7.0 - q * (1.0 / 9.0 - q / 11.0)))))
    return math.atan2(across, along)


@inner
def step_residual(
    start: Float, heading: tuple[float, float], motion: Float, motion_turn: Float, end: Float
) -> tuple[float, float, float]:
    """Log(measured^-1 between) of a step from pose `start` to `end`, in the frame of its end.

    `heading` is that of the start as `facing` has it.
    """
    c, s = heading
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = c * dx + s * dy - motion[0], c * dy - s * dx - motion[1]
    turn = wrap(end[2] - start[2] - motion[2])
    c, s = motion_turn[0], motion_turn[1]
    x, y = log_se2(c * x + s * y, c * y - s * x, turn)
    return x, y, turn


@inner
def right_jacobian(x: float, y: float, turn: float) -> tuple[float, float, float, float]:
    """SE(2)'s right Jacobian at a logarithm, [[j00, j01, j02], [-j01, j00, j12], [0, 0, 1]]: j00, j01, j02 and j12."""
    if abs(turn) < 1e-2:
        j00 = 1.0 - turn * turn / 6.0 + turn**4 / 120.0
        j01 = 0.5 * turn - turn**3 / 24.0 + turn**5 / 720.0
        b = 0.5 - turn * turn / 24.0 + turn**4 / 720.0
        a = turn / 6.0 - turn**3 / 120.0 + turn**5 / 5040.0
    else:
        j00, j01 = math.sin(turn) / turn, 2.0 * math.sin(0.5 * turn) ** 2 / turn
        b, a = j01 / turn, (turn - math.sin(turn)) / (turn * turn)
    return j00, j01, a * x - b * y, b * x + a * y


@inner
def sight_of(measured: Measured, row: int) -> Sight:
    """The observation in a row; of bearings alone, what is of a second number repeats the first."""
    z, direction, whitener = measured.value[row], measured.direction[row], measured.whitener[row]
    return Sight(z[0], z[-1], direction[0], direction[1], whitener[0, 0], whitener[-1, 0], whitener[-1, -1])


@inner
def observe(
    sensor: int, sight: Sight, heading: tuple[float, float], ex: float, ey: float
) -> tuple[float, float, float, float, float, float]:
    """Whitened residual h - z (2,) and its gradients (2, 2) by the landmark, which is at (ex, ey) from the pose.

    `heading` is that of the pose as `facing` has it. Of bearings alone, the second row is zero.
    """
    c, s = heading
    w00, w10, w11 = sight.w00, sight.w10, sight.w11
    if sensor == POSITION:
        r0, r1, a00, a01, a10, a11 = c * ex + s * ey - sight.z0, c * ey - s * ex - sight.z1, c, s, -s, c
    else:
        x, y = c * sight.cosine - s * sight.sine, s * sight.cosine + c * sight.sine  # where the bearing points
        r1 = angle_of(x * ex + y * ey, x * ey - y * ex)
        distance = math.sqrt(ex * ex + ey * ey)
        nearness = 1.0 / distance
        a00, a01 = ex * nearness, ey * nearness
        a10, a11 = -a01 * nearness, a00 * nearness
        if sensor == BEARING:
            return w00 * r1, 0.0, w00 * a10, w00 * a11, 0.0, 0.0
        r0 = distance - sight.z0
    return w00 * r0, w10 * r0 + w11 * r1, w00 * a00, w00 * a01, w10 * a00 + w11 * a10, w10 * a01 + w11 * a11
