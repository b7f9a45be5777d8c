"""Chord (simplified Newton) steps of an incremental optimum, compiled.

A chord step uses the gradient of the exact cost at the current state, but each pose's matrices P and T from the state
at which it was eliminated (`elimination`). It costs a few hundred operations per pose instead of a product of L x L
matrices. At convergence the gradient is zero, so outdated matrices cost steps but no accuracy.

With zero variances the gradient by the poses would be infinite. The step therefore uses the multipliers of the motions:
l_k = F' l_{k+1} + Hx' r at the current state. The noise -c_k of a motion should be -W_k l_k, and c_k - W_k l_k is its
defect.

Source: Shamanskii (1967), Newton steps with a constant matrix.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.solver.elimination import Chain, Scans
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import exp, wrap


class ChordStep(NamedTuple):
    """A chord step, and the intermediate results of its recursions."""

    pose: Float  # (N+1, 3)
    landmark: Float  # (L, 2) first the negative gradient of the cost, then the step
    rhs: Float  # (N+1, 3) negative gradient by the poses that the landmarks' step adds
    defect: Float  # (N+1, 3)
    mean: Float  # (N+1, 3)
    seen: Float  # (M, d) change of every predicted observation, in sigmas


def empty_step(poses: int, landmarks: int, observations: int, dim: int) -> ChordStep:
    """Return a chord step of zeros."""
    rhs, defect, mean = np.zeros((3, poses, 3))
    return ChordStep(
        np.zeros((poses, 3)), np.zeros((landmarks, 2)), rhs, defect, mean, np.zeros((observations, dim))
    )


@kernel
def compute_gradient(scans: Scans, now: LinearModel, newest: int, step: ChordStep) -> float:
    """Compute the defects and the negative gradient by the landmarks; return the sum of squared residuals.

    The sum is exact if the defects are zero: the noise of a motion is then -W l, and its weighted square l' W l.
    """
    l0, l1, l2, squares = 0.0, 0.0, 0.0, 0.0
    step.landmark[:] = 0.0
    for k in range(newest, -1, -1):
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            if slot < 0:
                continue
            for i in range(now.r.shape[1]):
                r = now.r[row, i]
                squares += r * r
                step.landmark[slot, 0] -= now.Hm[row, i, 0] * r
                step.landmark[slot, 1] -= now.Hm[row, i, 1] * r
                l0 += now.Hx[row, i, 0] * r
                l1 += now.Hx[row, i, 1] * r
                l2 += now.Hx[row, i, 2] * r
        for i in range(3):
            noise = now.W[k, i, 0] * l0 + now.W[k, i, 1] * l1 + now.W[k, i, 2] * l2
            squares += noise * (l0 if i == 0 else l1 if i == 1 else l2)
            step.defect[k, i] = now.c[k, i] - noise
        l2 += now.lever[k, 0] * l0 + now.lever[k, 1] * l1
    return squares


@kernel
def staleness(scans: Scans, now: LinearModel, model: LinearModel, newest: int) -> float:
    """Return the relative change of the Jacobians from `model` to `now`.

    It is the larger one of two: observations by landmarks, and the newest pose by earlier headings.
    """
    moved, norm, turned, length = 0.0, 0.0, 0.0, 0.0
    before, after = np.zeros(2), np.zeros(2)  # levers from pose k - 1 to the newest pose
    for k in range(newest, -1, -1):
        for j in range(2):
            before[j] += model.lever[k, j]
            after[j] += now.lever[k, j]
            if k > 0:
                turned += (after[j] - before[j]) ** 2
                length += after[j] ** 2
    for row in range(scans.first[newest + 1]):
        if scans.slot[row] >= 0:
            for i in range(now.r.shape[1]):
                for j in range(2):
                    norm += now.Hm[row, i, j] ** 2
                    moved += (now.Hm[row, i, j] - model.Hm[row, i, j]) ** 2
    return math.sqrt(max(moved / norm if norm > 0.0 else 0.0, turned / length if length > 0.0 else 0.0))


@kernel
def solve_step(scans: Scans, model: LinearModel, chain: Chain, factor: Float, newest: int, step: ChordStep) -> float:
    """Compute the chord step from defects and gradient; return the length of the change of predicted observations.

    Args:
        scans: observations by pose.
        model: linearised where the poses were eliminated.
        chain: of the eliminated poses.
        factor: (2L, 2L) lower triangular Cholesky factor of the landmarks' information.
        newest: pose.
        step: with defects and gradient.
    """
    step.rhs[: newest + 1] = 0.0
    smooth(model, chain, newest, step)
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            if slot >= 0:
                for i in range(model.r.shape[1]):
                    change = along(model.Hx[row, i], step.pose[k])
                    step.landmark[slot, 0] -= model.Hm[row, i, 0] * change
                    step.landmark[slot, 1] -= model.Hm[row, i, 1] * change
    solve_factored(factor, step.landmark.ravel())
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            for i in range(model.r.shape[1]):
                change = 0.0
                if slot >= 0:
                    h, landmark = model.Hm[row, i], step.landmark[slot]
                    change = h[0] * landmark[0] + h[1] * landmark[1]
                    for j in range(3):
                        step.rhs[k, j] -= model.Hx[row, i, j] * change
                step.seen[row, i] = change
    smooth(model, chain, newest, step)
    squares = 0.0
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            if scans.slot[row] >= 0:
                for i in range(model.r.shape[1]):
                    step.seen[row, i] += along(model.Hx[row, i], step.pose[k])
                    squares += step.seen[row, i] ** 2
    return math.sqrt(squares)


@inner
def along(a: Float, b: Float) -> float:
    """Return a' b of vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def solve_factored(factor: Float, x: Float) -> None:
    """Replace the first entries of x by (L L')^-1 x, for a lower triangular L."""
    for i in range(len(factor)):
        for j in range(i):
            x[i] -= factor[i, j] * x[j]
        x[i] /= factor[i, i]
    for i in range(len(factor) - 1, -1, -1):
        x[i] /= factor[i, i]
        for j in range(i):
            x[j] -= factor[i, j] * x[i]


@inner
def smooth(model: LinearModel, chain: Chain, newest: int, step: ChordStep) -> None:
    """Compute the step of every pose for its defects and right-hand sides, with fixed landmarks."""
    mean, x, ahead, z, back = step.mean, np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(newest + 1):
        x[0] += model.lever[k, 0] * x[2]
        x[1] += model.lever[k, 1] * x[2]
        for i in range(3):
            x[i] += step.defect[k, i]
            mean[k, i] = x[i]
        observe(chain, k, x, step.rhs[k], z, back)
        for i in range(3):
            x[i] = z[i] - along(chain.P[k, i], back)
    for k in range(newest, -1, -1):
        for i in range(3):
            ahead[i] += step.rhs[k, i]
        observe(chain, k, mean[k], ahead, z, back)
        for i in range(3):
            step.pose[k, i] = z[i] - along(chain.P[k, i], back)
            ahead[i] -= back[i]
        ahead[2] += model.lever[k, 0] * ahead[0] + model.lever[k, 1] * ahead[1]


@inner
def observe(chain: Chain, k: int, x: Float, rhs: Float, z: Float, back: Float) -> None:
    """Compute z = x + P rhs and back = T' T z."""
    T = chain.T[k]
    for i in range(3):
        z[i] = x[i] + along(chain.P[k, i], rhs)
        back[i] = 0.0
    for i in range(3):
        seen = along(T[i], z)
        for j in range(3):
            back[j] += T[i, j] * seen


@kernel
def move(scans: Scans, poses: Float, landmarks: Float, step: ChordStep) -> None:
    """Move poses (n, 3) and landmarks (l, 2) by a chord step, each point by V(turn) step, V(t) = (R(t) - I) / (t J).

    A rotation of all points about a common centre then keeps all distances; an additive step would stretch them. The
    turn of a landmark is the mean turn of the poses that observe it.
    """
    turns, seen = np.zeros(len(landmarks)), np.zeros(len(landmarks))
    for k in range(len(poses)):
        turn = step.pose[k, 2]
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            if slot >= 0:
                turns[slot] += turn
                seen[slot] += 1.0
        move_point(poses[k], step.pose[k], turn)
        poses[k, 2] = wrap(poses[k, 2] + turn)
    for slot in range(len(landmarks)):
        move_point(landmarks[slot], step.landmark[slot], turns[slot] / max(seen[slot], 1.0))


@inner
def move_point(point: Float, step: Float, turn: float) -> None:
    """Move a point by V(turn) step."""
    x, y = exp(step[0], step[1], turn)
    point[0] += x
    point[1] += y
