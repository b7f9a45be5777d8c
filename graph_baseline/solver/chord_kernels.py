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
from slamgauge.formula_kernels import exp, wrap
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans, Triple
from slamgauge.graph_baseline.solver.elimination import Chain
from slamgauge.jit import inner, kernel


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
    return ChordStep(np.zeros((poses, 3)), np.zeros((landmarks, 2)), rhs, defect, mean, np.zeros((observations, dim)))


@kernel
def compute_gradient(
    scans: Scans, newest: int, model: LinearModel, now: LinearModel, step: ChordStep
) -> tuple[float, float]:
    """Compute the defects and the negative gradient by the landmarks at the current state.

    Args:
        scans: observations by pose.
        newest: pose.
        model: linearised where the poses were eliminated.
        now: linearised at the current state.
        step: gets defects and gradient.

    Returns:
        The sum of squared residuals, and `staleness`. The sum is exact if the defects are zero: the noise of a motion
        is then -W l, and its weighted square l' W l.
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
        n0, n1, n2 = times(now.W, k, (l0, l1, l2))
        squares += n0 * l0 + n1 * l1 + n2 * l2
        step.defect[k, 0], step.defect[k, 1], step.defect[k, 2] = now.c[k, 0] - n0, now.c[k, 1] - n1, now.c[k, 2] - n2
        l2 += now.lever[k, 0] * l0 + now.lever[k, 1] * l1
    return squares, staleness(scans, now, model, newest)


@inner
def staleness(scans: Scans, now: LinearModel, model: LinearModel, newest: int) -> float:
    """Return the relative change of the Jacobians from `model` to `now`.

    It is the larger one of two: observations by landmarks, and the newest pose by earlier headings.
    """
    moved, norm, turned, length = 0.0, 0.0, 0.0, 0.0
    before, after = (0.0, 0.0), (0.0, 0.0)  # levers from pose k - 1 to the newest pose
    for k in range(newest, 0, -1):
        before = before[0] + model.lever[k, 0], before[1] + model.lever[k, 1]
        after = after[0] + now.lever[k, 0], after[1] + now.lever[k, 1]
        turned += (after[0] - before[0]) ** 2 + (after[1] - before[1]) ** 2
        length += after[0] ** 2 + after[1] ** 2
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
    Hx, Hm, pose, landmark, dim = model.Hx, model.Hm, step.pose, step.landmark, model.r.shape[1]
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            if slot >= 0:
                for i in range(dim):
                    change = Hx[row, i, 0] * pose[k, 0] + Hx[row, i, 1] * pose[k, 1] + Hx[row, i, 2] * pose[k, 2]
                    landmark[slot, 0] -= Hm[row, i, 0] * change
                    landmark[slot, 1] -= Hm[row, i, 1] * change
    solve_factored(factor, landmark.ravel())
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            slot = scans.slot[row]
            for i in range(dim):
                if slot >= 0:
                    change = Hm[row, i, 0] * landmark[slot, 0] + Hm[row, i, 1] * landmark[slot, 1]
                    for j in range(3):
                        step.rhs[k, j] -= Hx[row, i, j] * change
                    step.seen[row, i] = change
                else:
                    step.seen[row, i] = 0.0
    smooth(model, chain, newest, step)
    squares = 0.0
    for k in range(newest + 1):
        for row in range(scans.first[k], scans.first[k + 1]):
            if scans.slot[row] >= 0:
                for i in range(dim):
                    change = Hx[row, i, 0] * pose[k, 0] + Hx[row, i, 1] * pose[k, 1] + Hx[row, i, 2] * pose[k, 2]
                    step.seen[row, i] += change
                    squares += step.seen[row, i] ** 2
    return math.sqrt(squares)


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
    rhs, defect, mean, x = step.rhs, step.defect, step.mean, (0.0, 0.0, 0.0)
    for k in range(newest + 1):
        x0, x1 = x[0] + model.lever[k, 0] * x[2], x[1] + model.lever[k, 1] * x[2]
        x = x0 + defect[k, 0], x1 + defect[k, 1], x[2] + defect[k, 2]
        mean[k, 0], mean[k, 1], mean[k, 2] = x
        x = observe(chain, k, x, (rhs[k, 0], rhs[k, 1], rhs[k, 2]))[0]
    a = 0.0, 0.0, 0.0
    for k in range(newest, -1, -1):
        a = a[0] + rhs[k, 0], a[1] + rhs[k, 1], a[2] + rhs[k, 2]
        x, b = observe(chain, k, (mean[k, 0], mean[k, 1], mean[k, 2]), a)
        step.pose[k, 0], step.pose[k, 1], step.pose[k, 2] = x
        a0, a1 = a[0] - b[0], a[1] - b[1]
        a = a0, a1, a[2] - b[2] + model.lever[k, 0] * a0 + model.lever[k, 1] * a1


@inner
def observe(chain: Chain, k: int, x: Triple, rhs: Triple) -> tuple[Triple, Triple]:
    """Return z - P b and b = T' T z, with z = x + P rhs."""
    z = plus(x, times(chain.P, k, rhs))
    b = times_transposed(chain.T, k, times(chain.T, k, z))
    return plus(z, times(chain.P, k, (-b[0], -b[1], -b[2]))), b


@inner
def plus(x: Triple, y: Triple) -> Triple:
    """Return x + y."""
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@inner
def times(A: Float, k: int, x: Triple) -> Triple:
    """Return A_k x for matrices A (n, 3, 3)."""
    return (
        A[k, 0, 0] * x[0] + A[k, 0, 1] * x[1] + A[k, 0, 2] * x[2],
        A[k, 1, 0] * x[0] + A[k, 1, 1] * x[1] + A[k, 1, 2] * x[2],
        A[k, 2, 0] * x[0] + A[k, 2, 1] * x[1] + A[k, 2, 2] * x[2],
    )


@inner
def times_transposed(A: Float, k: int, x: Triple) -> Triple:
    """Return A_k' x for matrices A (n, 3, 3)."""
    return (
        A[k, 0, 0] * x[0] + A[k, 1, 0] * x[1] + A[k, 2, 0] * x[2],
        A[k, 0, 1] * x[0] + A[k, 1, 1] * x[1] + A[k, 2, 1] * x[2],
        A[k, 0, 2] * x[0] + A[k, 1, 2] * x[1] + A[k, 2, 2] * x[2],
    )


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
