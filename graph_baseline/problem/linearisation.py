"""The exact model of a recording, linearised by compiled kernels.

Unknowns are additive, in world coordinates: dx_k = (x, y, heading) of pose k, dm = landmark positions. The noise of a
motion is that of GTSAM's between factor: its residual xi = Log(measured^-1 between), with the logarithm of SE(2), has
the covariance of the odometry in the frame of the step's end. The start is treated as a motion from the prior mean.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.formula_kernels import POSITION, log, right_jacobian, wrap
from slamgauge.graph_baseline.problem.preparation import Problem, prior_cov_in_body
from slamgauge.jit import inner, kernel
from slamgauge.sensors import SENSORS

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Quadruple = tuple[float, float, float, float]


class GraphArrays(NamedTuple):
    """A problem as contiguous arrays for kernels."""

    sensor: int  # code
    start: Float  # (3,) prior mean
    motion: Float  # (N+1, 3) increment that leads to pose k; 0 for pose 0
    turn: Float  # (N+1, 2) cosine and sine of the increment's turn
    motion_cov: Float  # (N+1, 3, 3) covariance in the body frame; that of the prior for pose 0
    first: Int  # (N+2,) row of pose k's first observation
    value: Float  # (M, d)
    direction: Float  # (M, 2) cosine and sine of the bearing, (1, 0) of a position
    whitener: Float  # (M, d, d) lower triangular L^-1 of the covariance L L'
    slot: Int  # (M,) index of the landmark, -1 for an unused observation


class Scans(NamedTuple):
    """Observations by pose."""

    first: Int  # (N+2,) row of pose k's first observation
    slot: Int  # (M,) index of the landmark, -1 for an unused observation


class LinearModel(NamedTuple):
    """dx_k = [I, lever_k; 0, 1] dx_{k-1} + c_k + w_k with w_k ~ N(0, W_k); 0 = Hx dx + Hm dm + r + e with e ~ N(0, I).

    Pose 0 has no predecessor: dx_0 = c_0 + w_0. Rows of unused observations are zero.
    """

    lever: Float  # (N+1, 2)
    c: Float  # (N+1, 3)
    W: Float  # (N+1, 3, 3), may be singular
    Hx: Float  # (M, d, 3), whitened
    Hm: Float  # (M, d, 2), whitened
    r: Float  # (M, d), whitened


def graph_arrays(problem: Problem) -> GraphArrays:
    """Return the problem as arrays; slots are indices in `Problem.landmark_ids`."""
    motion = np.concatenate([np.zeros((1, 3)), problem.odometry])
    model = SENSORS[problem.sensor]
    bearing = problem.observation[:, -1] if model.has_bearing else np.zeros(len(problem.observation))
    return GraphArrays(
        sensor=model.code,
        start=np.array(problem.prior_mean, dtype=np.float64),
        motion=motion,
        turn=np.column_stack([np.cos(motion[:, 2]), np.sin(motion[:, 2])]),
        motion_cov=np.ascontiguousarray(np.concatenate([prior_cov_in_body(problem)[None], problem.odometry_cov])),
        first=np.searchsorted(problem.observation_step, np.arange(problem.steps + 2)),
        value=np.array(problem.observation, dtype=np.float64),
        direction=np.column_stack([np.cos(bearing), np.sin(bearing)]),
        whitener=np.ascontiguousarray(inverse_cholesky(problem.observation_cov)),
        slot=np.array(problem.slot),
    )


def inverse_cholesky(covariance: Float) -> Float:
    """Return lower triangular L^-1 (M, d, d) of covariances L L' (M, d, d)."""
    if covariance.shape[1] == 1:
        return 1.0 / np.sqrt(covariance)
    first = 1.0 / np.sqrt(covariance[:, 0, 0])
    slope = covariance[:, 0, 1] * first
    second = 1.0 / np.sqrt(covariance[:, 1, 1] - slope**2)
    inverse = np.zeros_like(covariance)
    inverse[:, 0, 0], inverse[:, 1, 1] = first, second
    inverse[:, 1, 0] = -slope * first * second
    return inverse


def empty_model(poses: int, observations: int, dim: int) -> LinearModel:
    """Return a model of zeros for `poses` poses and observations (M, dim)."""
    shapes = (poses, 2), (poses, 3), (poses, 3, 3)
    rows = (observations, dim, 3), (observations, dim, 2), (observations, dim)
    return LinearModel(*map(np.zeros, shapes + rows))


@kernel
def linearise(arrays: GraphArrays, poses: Float, landmarks: Float, steps: tuple[int, int], model: LinearModel) -> None:
    """Fill the rows of a model for poses steps[0]..steps[1]-1, at poses (N+1, 3) and landmarks (L, 2).

    A landmark at the position of a pose that observes it gives infinite or undefined entries.
    """
    dim, begin = arrays.value.shape[1], steps[0]
    end = (arrays.start[0], arrays.start[1], arrays.start[2])
    if begin > 0:
        end = (poses[begin - 1, 0], poses[begin - 1, 1], poses[begin - 1, 2])
    heading = math.cos(end[2]), math.sin(end[2])
    for k in range(begin, steps[1]):
        start, before, end = end, heading, (poses[k, 0], poses[k, 1], poses[k, 2])
        heading = math.cos(end[2]), math.sin(end[2])
        if k > 0:
            model.lever[k, 0], model.lever[k, 1] = start[1] - end[1], end[0] - start[0]
        linearise_motion(
            start,
            before,
            end,
            heading,
            (arrays.motion[k, 0], arrays.motion[k, 1], arrays.motion[k, 2]),
            (arrays.turn[k, 0], arrays.turn[k, 1]),
            arrays.motion_cov[k],
            model.c[k],
            model.W[k],
        )
        for row in range(arrays.first[k], arrays.first[k + 1]):
            slot = arrays.slot[row]
            if slot < 0:
                for i in range(dim):
                    model.r[row, i] = model.Hm[row, i, 0] = model.Hm[row, i, 1] = 0.0
                    model.Hx[row, i, 0] = model.Hx[row, i, 1] = model.Hx[row, i, 2] = 0.0
                continue
            ex, ey = landmarks[slot, 0] - poses[k, 0], landmarks[slot, 1] - poses[k, 1]
            value = arrays.value[row, 0], arrays.value[row, dim - 1]
            direction = arrays.direction[row, 0], arrays.direction[row, 1]
            r, A = linearise_observation(arrays.sensor, value, direction, heading, (ex, ey))
            for i in range(dim):
                if dim == 1:
                    w = 0.0, arrays.whitener[row, 0, 0]
                else:
                    w = arrays.whitener[row, i, 0], arrays.whitener[row, i, 1]
                x, y = w[0] * A[0] + w[1] * A[2], w[0] * A[1] + w[1] * A[3]
                model.r[row, i] = w[0] * r[0] + w[1] * r[1]
                model.Hm[row, i, 0], model.Hm[row, i, 1] = x, y
                model.Hx[row, i, 0], model.Hx[row, i, 1], model.Hx[row, i, 2] = -x, -y, x * ey - y * ex


@inner
def linearise_motion(
    start: Triple, before: Pair, end: Triple, heading: Pair, motion: Triple, turn: Pair, Q: Float, c: Float, W: Float
) -> None:
    """Compute c = -turn xi and W = B Q B', B = turn J_r(xi), of a motion between two poses.

    `before`, `heading` and `turn` are cosines and sines of the headings of `start` and `end`, and of the measured turn.
    """
    x, y, t = motion_residual(start, before, end, motion, turn)
    j00, j01, j02, j12 = right_jacobian(x, y, t)
    cosine, sine = heading
    c[0], c[1], c[2] = sine * y - cosine * x, -sine * x - cosine * y, -t
    b00, b01, b02 = cosine * j00 + sine * j01, cosine * j01 - sine * j00, cosine * j02 - sine * j12
    b10, b11, b12 = sine * j00 - cosine * j01, sine * j01 + cosine * j00, sine * j02 + cosine * j12
    q0, q1, q2 = row_product(b00, b01, b02, Q)
    p0, p1, p2 = row_product(b10, b11, b12, Q)
    W[0, 0], W[1, 1], W[2, 2] = q0 * b00 + q1 * b01 + q2 * b02, p0 * b10 + p1 * b11 + p2 * b12, Q[2, 2]
    W[0, 1] = W[1, 0] = q0 * b10 + q1 * b11 + q2 * b12
    W[0, 2], W[2, 0], W[1, 2], W[2, 1] = q2, q2, p2, p2


@inner
def row_product(b0: float, b1: float, b2: float, Q: Float) -> Triple:
    """Return the row (b0, b1, b2) Q for Q (3, 3)."""
    return (
        b0 * Q[0, 0] + b1 * Q[1, 0] + b2 * Q[2, 0],
        b0 * Q[0, 1] + b1 * Q[1, 1] + b2 * Q[2, 1],
        b0 * Q[0, 2] + b1 * Q[1, 2] + b2 * Q[2, 2],
    )


@inner
def motion_residual(start: Triple, before: Pair, end: Triple, motion: Triple, turn: Pair) -> Triple:
    """Return the residual xi = Log(motion^-1 start^-1 end) [m, m, rad], in the frame of `end`."""
    c, s = before
    dx, dy = end[0] - start[0], end[1] - start[1]
    x, y = c * dx + s * dy - motion[0], c * dy - s * dx - motion[1]
    t = wrap(end[2] - start[2] - motion[2])
    x, y = log(turn[0] * x + turn[1] * y, turn[0] * y - turn[1] * x, t)
    return x, y, t


@inner
def linearise_observation(
    sensor: int, value: Pair, direction: Pair, heading: Pair, offset: Pair
) -> tuple[Pair, Quadruple]:
    """Return the residuals of an observation, and their Jacobian (2, 2) by the landmark, in rows.

    Residuals are those of range [m] and bearing [rad], or of the position [m]; `bearing` uses only the second one.
    Bearings are computed in a frame whose x axis is the measured bearing. There the predicted bearing equals the
    residual, which is usually small, so that a series replaces the arc tangent.

    Args:
        sensor: code.
        value: range [m] and bearing [rad], or position [m].
        direction: cosine and sine of the measured bearing.
        heading: cosine and sine of the heading.
        offset: of the landmark from the pose, world frame [m].
    """
    (c, s), (ex, ey) = heading, offset
    if sensor == POSITION:
        return (c * ex + s * ey - value[0], c * ey - s * ex - value[1]), (c, s, -s, c)
    along, across = direction
    x, y = c * along - s * across, s * along + c * across  # direction of the measured bearing
    distance = math.sqrt(ex * ex + ey * ey)
    nearness = 1.0 / distance
    ux, uy = ex * nearness, ey * nearness
    residuals = distance - value[0], angle_of(x * ex + y * ey, x * ey - y * ex)
    return residuals, (ux, uy, -uy * nearness, ux * nearness)


@inner
def angle_of(along: float, across: float) -> float:
    """Return the angle [rad], atan2(across, along); a series replaces the slower `atan2` at small angles."""
    if abs(across) < 0.05 * along:
        t = across / along
        q = t * t
        return t * (1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * (1.0 / 7.0 - q * (1.0 / 9.0 - q / 11.0)))))
    return math.atan2(across, along)
