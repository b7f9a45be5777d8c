"""Chord (simplified Newton) steps of an incremental optimum, compiled.

A chord step uses the gradient of the exact cost at the current state, but each pose's matrices from the time when it
was added (`pose_elimination`). It costs a few hundred operations per pose instead of a product of L x L matrices. At
convergence the gradient is zero, so outdated matrices cost steps but no accuracy. With zero variances the gradient by
the poses would be infinite. The step therefore uses the multipliers l_k of the motions, and the defect W_k l_k - w_k
of each motion's noise w_k.

Source: Shamanskii (1967), Newton steps with a constant matrix.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.residuals import (
    Measured,
    cosine_sine,
    observation_residual,
    observation_row,
    step_residual,
)
from slamgauge.graph_baseline.solver.linear_problem import Linear, State
from slamgauge.graph_baseline.solver.matrices_3x3 import multiply
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import exp, right_jacobian, wrap


class Chord(NamedTuple):
    """A chord step, and the intermediate results of its recursions."""

    pose: Float  # (N+1, 3)
    landmark: Float  # (L, 2) first the negative gradient of the cost, then the step
    rhs: Float  # (N+1, 3) negative gradient of the cost that the landmarks' step adds
    defect: Float  # (N+1, 3) W l - w
    mean: Float  # (N+1, 3)
    seen: Float  # (M, d) change of every predicted observation, in sigmas


def allocate_chord(poses: int, landmarks: int, observations: int, dim: int) -> Chord:
    """Allocate a chord step."""
    rhs, defect, mean = np.zeros((3, poses, 3))
    seen = np.zeros((observations, dim))
    return Chord(np.zeros((poses, 3)), np.zeros((landmarks, 2)), rhs, defect, mean, seen)


@kernel
def compute_defects(measured: Measured, linear: Linear, state: State, newest: int, chord: Chord) -> tuple[float, float]:
    """Compute the defects of all motions and the negative gradient by the landmarks, of the exact cost at `state`.

    Returns:
        The relative change of the Jacobians since their linearisation, and the sum of squared residuals. The change is
        the larger one of two: observations by landmarks, and the newest pose by earlier headings. The sum is exact if
        the defects are zero: the noise of a motion is then W l, and its weighted square l' W l.
    """
    poses, landmarks_at = state
    chord.landmark[:] = 0.0
    chord.rhs[: newest + 1] = 0.0
    sensor, dim = measured.sensor, measured.value.shape[1]
    l0, l1, l2 = 0.0, 0.0, 0.0
    moved, norm, squares = 0.0, 0.0, 0.0
    turned, length = 0.0, 0.0
    lever = np.zeros(2)  # from pose k - 1 to the newest pose, at the linearisation point
    heading = cosine_sine(poses[newest])
    for k in range(newest, -1, -1):
        if k > 0:
            lever += linear.lever[k]
            fx, fy = poses[k - 1, 1] - poses[newest, 1], poses[newest, 0] - poses[k - 1, 0]
            turned += (fx - lever[0]) ** 2 + (fy - lever[1]) ** 2
            length += fx * fx + fy * fy
        if k < newest:
            l2 += (poses[k, 1] - poses[k + 1, 1]) * l0 + (poses[k + 1, 0] - poses[k, 0]) * l1
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            ex, ey = landmarks_at[slot, 0] - poses[k, 0], landmarks_at[slot, 1] - poses[k, 1]
            r0, r1, a00, a01, a10, a11 = observation_residual(sensor, observation_row(measured, row), heading, ex, ey)
            squares += r0 * r0 + r1 * r1
            g0, g1 = a00 * r0 + a10 * r1, a01 * r0 + a11 * r1
            norm += a00 * a00 + a01 * a01 + a10 * a10 + a11 * a11
            moved += (a00 - linear.Hm[row, 0, 0]) ** 2 + (a01 - linear.Hm[row, 0, 1]) ** 2
            if dim == 2:
                moved += (a10 - linear.Hm[row, 1, 0]) ** 2 + (a11 - linear.Hm[row, 1, 1]) ** 2
            chord.landmark[slot, 0] -= g0
            chord.landmark[slot, 1] -= g1
            l0 += g0
            l1 += g1
            l2 += g1 * ex - g0 * ey
        start = measured.start if k == 0 else poses[k - 1]
        heading_before = cosine_sine(start)
        x, y, t = step_residual(start, heading_before, measured.motion[k], measured.motion_turn[k], poses[k])
        j00, j01, j02, j12 = right_jacobian(x, y, t)
        c, s = heading
        b0, b1 = c * l0 + s * l1, c * l1 - s * l0  # b: multipliers in the body frame; t: multipliers of the residual
        t0, t1, t2 = j00 * b0 - j01 * b1, j01 * b0 + j00 * b1, j02 * b0 + j12 * b1 + l2
        Q = measured.motion_cov[k]
        q0 = Q[0, 0] * t0 + Q[0, 1] * t1 + Q[0, 2] * t2
        q1 = Q[1, 0] * t0 + Q[1, 1] * t1 + Q[1, 2] * t2
        q2 = Q[2, 0] * t0 + Q[2, 1] * t1 + Q[2, 2] * t2
        squares += t0 * q0 + t1 * q1 + t2 * q2
        d0, d1 = j00 * q0 + j01 * q1 + j02 * q2 - x, j00 * q1 - j01 * q0 + j12 * q2 - y
        chord.defect[k, 0], chord.defect[k, 1], chord.defect[k, 2] = c * d0 - s * d1, s * d0 + c * d1, q2 - t
        heading = heading_before
    seen, walked = moved / norm if norm > 0.0 else 0.0, turned / length if length > 0.0 else 0.0
    return math.sqrt(max(seen, walked)), squares


@kernel
def smooth(linear: Linear, newest: int, chord: Chord) -> None:
    """Compute the step of every pose for its defects and right-hand sides, with fixed landmarks."""
    mean, G, P, N = chord.mean, linear.G, linear.P, linear.N
    x, ahead, total = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(newest + 1):
        if k > 0:
            x[0] += linear.lever[k, 0] * x[2]
            x[1] += linear.lever[k, 1] * x[2]
        for i in range(3):
            x[i] += chord.defect[k, i]
        for i in range(3):
            mean[k, i] = total[i] = x[i]
            for j in range(3):
                total[i] += P[k, i, j] * chord.rhs[k, j]
        multiply(G[k], total, x)
    for k in range(newest, -1, -1):
        if k < newest:
            ahead[2] += linear.lever[k + 1, 0] * ahead[0] + linear.lever[k + 1, 1] * ahead[1]
        for i in range(3):
            ahead[i] += chord.rhs[k, i]
        for i in range(3):
            total[i] = mean[k, i]
            for j in range(3):
                total[i] += P[k, i, j] * ahead[j]
        multiply(G[k], total, chord.pose[k])
        for i in range(3):
            for j in range(3):
                ahead[i] -= N[k, i, j] * chord.pose[k, j]


@kernel
def subtract_pose_step(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Subtract Hm' Hx dx, with the step dx of the poses, from the landmarks' right-hand side."""
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            for i in range(measured.value.shape[1]):
                h = linear.Hx[row, i]
                seen = h[0] * chord.pose[k, 0] + h[1] * chord.pose[k, 1] + h[2] * chord.pose[k, 2]
                for j in range(2):
                    chord.landmark[slot, j] -= linear.Hm[row, i, j] * seen


@kernel
def subtract_landmark_step(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Set the right-hand sides of the poses to -Hx' Hm dm, with the step dm of the landmarks."""
    chord.rhs[: newest + 1] = 0.0
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            for i in range(measured.value.shape[1]):
                h = linear.Hm[row, i]
                seen = h[0] * chord.landmark[slot, 0] + h[1] * chord.landmark[slot, 1]
                for j in range(3):
                    chord.rhs[k, j] -= linear.Hx[row, i, j] * seen


@kernel
def predict_changes(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Compute the change of every predicted observation by the step."""
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            for i in range(measured.value.shape[1]):
                change = 0.0
                if slot >= 0:
                    h, pose, landmark = linear.Hx[row, i], chord.pose[k], chord.landmark[slot]
                    change += h[0] * pose[0] + h[1] * pose[1] + h[2] * pose[2]
                    change += linear.Hm[row, i, 0] * landmark[0] + linear.Hm[row, i, 1] * landmark[1]
                chord.seen[row, i] = change


@kernel
def move(measured: Measured, state: State, newest: int, landmarks: int, chord: Chord) -> None:
    """Move path and map by a chord step, each point by V(turn) step, V(t) = (R(t) - I) / (t J).

    A rotation of all points about a common centre then keeps all distances; an additive step would stretch them. The
    turn of a landmark is the mean turn of the poses that observe it.
    """
    turns, seen = np.zeros(landmarks), np.zeros(landmarks)
    for k in range(newest + 1):
        turn = chord.pose[k, 2]
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            turns[slot] += turn
            seen[slot] += 1.0
        retract_point(state.poses[k], chord.pose[k], turn)
        state.poses[k, 2] = wrap(state.poses[k, 2] + turn)
    for slot in range(landmarks):
        retract_point(state.landmarks[slot], chord.landmark[slot], turns[slot] / max(seen[slot], 1.0))


@inner
def retract_point(point: Float, step: Float, turn: float) -> None:
    """Move a point by V(turn) step."""
    x, y = exp(step[0], step[1], turn)
    point[0] += x
    point[1] += y
