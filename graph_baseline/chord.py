"""Chord steps of an optimum that grows pose by pose, compiled.

A chord step takes the gradient of the exact cost where the path and the map stand, and the matrices where they were
taken in (`elimination`): it costs a few hundred operations a pose instead of a product of L x L matrices, and where it
comes to rest the gradient is zero, so that stale matrices cost steps but no accuracy. In place of the gradient by the
poses, which zero variances make infinite, it takes the multipliers l_k of the steps that lead to them, and what the
step's noise w_k lacks of W_k l_k.

Source: the step that keeps its matrix is Shamanskii's (1967).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compiled import inner, kernel
from slamgauge.graph_baseline.linear_problem import Linear, Place
from slamgauge.graph_baseline.models import Measured, observe, step_noise, wrap
from slamgauge.graph_baseline.three_by_three import multiply


class Chord(NamedTuple):
    """A step, and what its recursions leave for one another."""

    pose: Float  # (N+1, 3)
    landmark: Float  # (L, 2) the step; before, the gradient of minus the cost
    pull: Float  # (N+1, 3) gradient of minus the cost that the landmarks' step adds
    defect: Float  # (N+1, 3) W l - w
    mean: Float  # (N+1, 3)
    seen: Float  # (M, d) what the step changes of every observation, in sigmas


def allocate_chord(poses: int, landmarks: int, observations: int, dim: int) -> Chord:
    """Room for a step."""
    pull, defect, mean = np.zeros((3, poses, 3))
    seen = np.zeros((observations, dim))
    return Chord(np.zeros((poses, 3)), np.zeros((landmarks, 2)), pull, defect, mean, seen)


@kernel
def find_defects(measured: Measured, linear: Linear, place: Place, newest: int, chord: Chord) -> tuple[float, float]:
    """Leave in `chord` the defects of all steps and the gradient by the landmarks, of the exact cost at `place`.

    Returns the relative change of Jacobians since they were taken in, of the observations' by their landmarks or, if
    that is more, of the newest pose's by the headings before; and the sum of squared residuals, exact where there are
    no defects: there a step's noise is W l, and its square l' W l.
    """
    poses, places = place
    chord.landmark[:] = 0.0
    chord.pull[: newest + 1] = 0.0
    r, Hx, Hm = np.empty(2), np.empty((2, 3)), np.empty((2, 2))
    w, B, t, Qt = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    l0, l1, l2 = 0.0, 0.0, 0.0
    moved, norm, squares = 0.0, 0.0, 0.0
    turned, length = 0.0, 0.0
    lever = np.zeros(2)  # from pose k - 1 to the newest, as taken in
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
            observe(measured, row, poses[k], places[slot], r, Hx, Hm)
            for i in range(measured.value.shape[1]):
                squares += r[i] * r[i]
                l0 -= Hx[i, 0] * r[i]
                l1 -= Hx[i, 1] * r[i]
                l2 -= Hx[i, 2] * r[i]
                chord.landmark[slot, 0] -= Hm[i, 0] * r[i]
                chord.landmark[slot, 1] -= Hm[i, 1] * r[i]
                for j in range(2):
                    moved += (Hm[i, j] - linear.Hm[row, i, j]) ** 2
                    norm += Hm[i, j] ** 2
        start = measured.start if k == 0 else poses[k - 1]
        step_noise(start, measured.motion[k], poses[k], w, B)
        Q = measured.motion_cov[k]
        for i in range(3):
            t[i] = B[0, i] * l0 + B[1, i] * l1 + B[2, i] * l2
        for i in range(3):
            Qt[i] = Q[i, 0] * t[0] + Q[i, 1] * t[1] + Q[i, 2] * t[2]
        for i in range(3):
            squares += t[i] * Qt[i]
            chord.defect[k, i] = B[i, 0] * Qt[0] + B[i, 1] * Qt[1] + B[i, 2] * Qt[2] - w[i]
    seen, walked = moved / norm if norm > 0.0 else 0.0, turned / length if length > 0.0 else 0.0
    return math.sqrt(max(seen, walked)), squares


@kernel
def smooth(linear: Linear, newest: int, chord: Chord) -> None:
    """Leave in `chord` the step of every pose that answers its defects and pulls, the landmarks standing still."""
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
                total[i] += P[k, i, j] * chord.pull[k, j]
        multiply(G[k], total, x)
    for k in range(newest, -1, -1):
        if k < newest:
            ahead[2] += linear.lever[k + 1, 0] * ahead[0] + linear.lever[k + 1, 1] * ahead[1]
        for i in range(3):
            ahead[i] += chord.pull[k, i]
        for i in range(3):
            total[i] = mean[k, i]
            for j in range(3):
                total[i] += P[k, i, j] * ahead[j]
        multiply(G[k], total, chord.pose[k])
        for i in range(3):
            for j in range(3):
                ahead[i] -= N[k, i, j] * chord.pose[k, j]


@kernel
def pull_landmarks(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Add to the landmarks' gradient what the poses' step does to it: -Hm' Hx step."""
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
def pull_poses(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Leave as pulls on the poses what the landmarks' step does to their gradients: -Hx' Hm step."""
    chord.pull[: newest + 1] = 0.0
    for k in range(newest + 1):
        for row in range(measured.first[k], measured.first[k + 1]):
            slot = measured.slot[row]
            if slot < 0:
                continue
            for i in range(measured.value.shape[1]):
                h = linear.Hm[row, i]
                seen = h[0] * chord.landmark[slot, 0] + h[1] * chord.landmark[slot, 1]
                for j in range(3):
                    chord.pull[k, j] -= linear.Hx[row, i, j] * seen


@kernel
def see(measured: Measured, linear: Linear, newest: int, chord: Chord) -> None:
    """Leave in `chord` what the step changes of every observation."""
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
def move(measured: Measured, place: Place, newest: int, landmarks: int, chord: Chord) -> None:
    """Move path and map by a chord step, each point by V(turn) step, V(t) = (R(t) - I) / (t J).

    A turn of everything about any point then keeps all distances, which an additive step would stretch. A landmark
    turns as do, in the mean, the poses that see it.
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
        move_point(place.poses[k], chord.pose[k], turn)
        place.poses[k, 2] = wrap(place.poses[k, 2] + turn)
    for slot in range(landmarks):
        move_point(place.landmarks[slot], chord.landmark[slot], turns[slot] / max(seen[slot], 1.0))


@inner
def move_point(point: Float, step: Float, turn: float) -> None:
    """Point <- point + V(turn) step."""
    along = math.sin(turn) / turn if turn != 0.0 else 1.0
    across = 2.0 * math.sin(0.5 * turn) ** 2 / turn if turn != 0.0 else 0.0
    point[0] += along * step[0] - across * step[1]
    point[1] += across * step[0] + along * step[1]
