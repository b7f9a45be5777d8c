"""Compiled kernels: exact residuals of motions and observations, and the gradients of observations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import inverse_cholesky
from slamgauge.graph_baseline.problem.preparation import prior_cov_in_body
from slamgauge.jit import inner
from slamgauge.recording import Recording
from slamgauge.se2_kernels import log, wrap
from slamgauge.sensor_kernels import BEARING, POSITION
from slamgauge.sensors import SENSORS


class Measured(NamedTuple):
    """A recording as arrays for kernels; `slot` is the index of the landmark, -1 for an unused observation."""

    sensor: int
    start: Float  # (3,) prior mean
    motion: Float  # (N+1, 3) increment that leads to pose k; 0 for pose 0
    motion_turn: Float  # (N+1, 2) cosine and sine of the increment's turn
    motion_cov: Float  # (N+1, 3, 3) covariance in the body frame; that of the prior for pose 0
    first: Int  # (N+2,) row of pose k's first observation
    value: Float  # (M, d)
    direction: Float  # (M, 2) cosine and sine of the bearing, (1, 0) of a position
    whitener: Float  # (M, d, d) lower triangular L^-1 of the covariance L L'
    slot: Int  # (M,)


class ObservationRow(NamedTuple):
    """One observation as numbers, because passing arrays takes longer than computing the residual."""

    z0: float
    z1: float
    cosine: float  # cosine and sine of the bearing
    sine: float
    w00: float  # w00, w10 and w11 are entries of the whitener
    w10: float
    w11: float


def measured_of(recording: Recording) -> Measured:
    """Return the recording as contiguous arrays for kernels; the slot of every observation is -1."""
    motion = np.concatenate([np.zeros((1, 3)), recording.odometry])
    model = SENSORS[recording.sensor]
    bearing = recording.observation[:, -1] if model.has_bearing else np.zeros(len(recording.observation))
    return Measured(
        sensor=model.code,
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
def cosine_sine(pose: Float) -> tuple[float, float]:
    """Return cosine and sine of the pose's heading."""
    return math.cos(pose[2]), math.sin(pose[2])


@inner
def angle_of(along: float, across: float) -> float:
    """Return the angle [rad], atan2(across, along); a series replaces the slower `atan2` at small angles."""
    if abs(across) < 0.05 * along:
        t = across / along
        q = t * t
        return t * (1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * (1.0 / 7.0 - q * (1.0 / 9.0 - q / 11.0)))))
    return math.atan2(across, along)


@inner
def step_residual(
    start: Float, heading: tuple[float, float], motion: Float, motion_turn: Float, end: Float
) -> tuple[float, float, float]:
    """Return the residual Log(motion^-1 * (start^-1 * end)) of a step [m, m, rad], in the frame of `end`.

    Args:
        start: (3,) pose before the step.
        heading: cosine and sine of the heading of `start`.
        motion: (3,) measured increment.
        motion_turn: (2,) cosine and sine of the turn of `motion`.
        end: (3,) pose after the step.
    """
    c, s = heading
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = c * dx + s * dy - motion[0], c * dy - s * dx - motion[1]
    turn = wrap(end[2] - start[2] - motion[2])
    c, s = motion_turn[0], motion_turn[1]
    x, y = log(c * x + s * y, c * y - s * x, turn)
    return x, y, turn


@inner
def observation_row(measured: Measured, row: int) -> ObservationRow:
    """Return observation `row` as numbers; for a bearing-only sensor, z1 equals z0, and w10 and w11 equal w00."""
    z, direction, whitener = measured.value[row], measured.direction[row], measured.whitener[row]
    return ObservationRow(z[0], z[-1], direction[0], direction[1], whitener[0, 0], whitener[-1, 0], whitener[-1, -1])


@inner
def observation_residual(
    sensor: int, observation: ObservationRow, heading: tuple[float, float], ex: float, ey: float
) -> tuple[float, float, float, float, float, float]:
    """Return the whitened residual L^-1 (h - z) and its gradients with respect to (ex, ey), whitened too.

    h is the predicted observation, z the measured one with covariance L L'. The six numbers are the residual (2), then
    its gradients (2, 2) row by row. The second row is zero for a bearing-only sensor.

    Bearings are computed in a frame whose x axis is the measured bearing. There the predicted bearing equals the
    residual, which is usually small, so that a series replaces the arc tangent. This takes half the time of
    `slamgauge.sensor_kernels.observe`.

    Args:
        sensor: code of the sensor.
        observation: see `observation_row`.
        heading: cosine and sine of the pose's heading.
        ex: x of the landmark minus x of the pose, world frame [m].
        ey: y of the landmark minus y of the pose, world frame [m].
    """
    c, s = heading
    w00, w10, w11 = observation.w00, observation.w10, observation.w11
    if sensor == POSITION:
        r0, r1, a00, a01, a10, a11 = c * ex + s * ey - observation.z0, c * ey - s * ex - observation.z1, c, s, -s, c
    else:
        x, y = (
            c * observation.cosine - s * observation.sine,
            s * observation.cosine + c * observation.sine,
        )  # direction of the bearing
        r1 = angle_of(x * ex + y * ey, x * ey - y * ex)
        distance = math.sqrt(ex * ex + ey * ey)
        nearness = 1.0 / distance
        a00, a01 = ex * nearness, ey * nearness
        a10, a11 = -a01 * nearness, a00 * nearness
        if sensor == BEARING:
            return w00 * r1, 0.0, w00 * a10, w00 * a11, 0.0, 0.0
        r0 = distance - observation.z0
    return w00 * r0, w10 * r0 + w11 * r1, w00 * a00, w00 * a01, w10 * a00 + w11 * a10, w10 * a01 + w11 * a11
