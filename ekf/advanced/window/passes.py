"""Gauss-Newton passes over a window of poses, compiled.

A pass is an information filter that runs forward through the window, with all Jacobians at the present estimate. A and
b define the cost 1/2 d'A d - b'd of a step d of the newest pose so far and of the rest. From one pose to the next,
d_i = F d_{i-1} - G w_i + G w. The information is propagated, A <- F^-T A F^-1, then w is eliminated: A <- A - A Z'Z A
with Z = U'^-1 L'G', Q = LL' and U'U = I + L'G'A G L. `Pass` stores the intermediate results, from which a backward pass
computes the multipliers of all motions.

Source: Sibley, Matthies and Sukhatme, "Sliding window filter with application to planetary landing", Journal of Field
Robotics 27(5), 2010.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.advanced.window.cost import (
    Observed,
    Prior,
    Problem,
    Window,
    heading_lever,
    noise_at,
    observation_error,
    observations_of,
    spent,
)
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.blas import cholesky, solve_factor
from slamgauge.ekf.kernels.rounding_limits import LEAST
from slamgauge.jit import inner, kernel


class Pass(NamedTuple):
    """Intermediate results of the forward pass for each motion, for the backward pass; n unknowns."""

    row: Float  # (k+1, 3, n) the robot's rows of A before w is eliminated
    pull: Float  # (k+1, 3) the robot's entries of b before w is eliminated
    root: Float  # (k+1, 3, 3) Z
    step: Float  # (k+1, 3) resulting multipliers


def allocate_pass(poses: int, unknowns: int) -> Pass:
    """Allocate the arrays of a pass."""
    return Pass(np.zeros((poses, 3, unknowns)), np.zeros((poses, 3)), np.zeros((poses, 3, 3)), np.zeros((poses, 3)))


@kernel
def add_prior(prior: Prior, pose: Float, rest: Float, landmarks: int, A: Float, b: Float) -> None:
    """Set A (upper triangle) and b to the prior's cost of a step of the first pose and the rest."""
    size = ROBOT + len(rest)
    lever = np.empty(size)
    heading_lever(pose, rest, landmarks, lever)
    for i in range(size):  # an error is a step minus the displacement by the rotation of the first pose
        lever[i] = -lever[i] if i != 2 else 1.0
    by_heading(prior.information, prior.gradient, lever, A, b)


@kernel
def by_heading(information: Float, gradient: Float, lever: Float, A: Float, b: Float) -> None:
    """A <- E' information E, b <- E' gradient; E is the identity with `lever` as the heading's column."""
    size = len(lever)
    A[:size, :size] = information
    b[:size] = gradient
    total, twice = 0.0, 0.0
    for i in range(size):
        along = 0.0
        for j in range(size):
            along += information[i, j] * lever[j]
        A[min(i, 2), max(i, 2)] = along
        total += lever[i] * gradient[i]
        twice += lever[i] * along
    b[2], A[2, 2] = total, twice


@kernel
def add_observations(observed: Observed, pose: Float, first: int, rest: Float, A: Float, b: Float) -> None:
    """Add the observations of a pose to A and b; `first` is the first entry of the pose."""
    r, H = np.empty(2), np.empty((2, 5))
    for row in range(len(observed.slot)):
        slot = observed.slot[row]
        if slot < 0:
            continue
        observation_error(observed, row, pose, rest[2 * slot : 2 * slot + 2], r, H)
        place = ROBOT + 2 * slot
        for p in range(5):
            i = first + p if p < 3 else place + p - 3
            b[i] -= H[0, p] * r[0] + H[1, p] * r[1]
            for q in range(5):
                j = first + q if q < 3 else place + q - 3
                if i <= j:
                    A[i, j] += H[0, p] * H[0, q] + H[1, p] * H[1, q]


@kernel
def add_kept(problem: Problem, A: Float, b: Float) -> None:
    """Add the observations of kept poses to A and b."""
    kept, rest, landmarks = problem.kept, problem.rest, problem.landmarks
    for j in range(len(kept.first) - 1):
        place = 2 * landmarks + 3 * j
        add_observations(observations_of(kept, j), rest[place : place + 3], ROBOT + place, rest, A, b)


@kernel
def add_first(problem: Problem, A: Float, b: Float) -> None:
    """Set A (upper triangle) and b to the cost of a step of the first pose and the rest: prior and first scan."""
    pose = problem.window.pose[0]
    add_prior(problem.prior, pose, problem.rest, problem.landmarks, A, b)
    add_observations(observations_of(problem.observed, 0), pose, 0, problem.rest, A, b)


@kernel
def set_prior(pose: Float, rest: Float, landmarks: int, A: Float, b: Float, prior: Prior) -> None:
    """Convert A (upper triangle) and b of a step of a first pose and the rest to a prior, with these as reference."""
    size = ROBOT + len(rest)
    lever, whole, half = np.empty(size), np.empty((size, size)), np.empty((size, size))
    heading_lever(pose, rest, landmarks, lever)
    for i in range(size):
        for j in range(size):
            whole[i, j] = A[min(i, j), max(i, j)]
    by_heading(whole, b[:size], lever, half, prior.gradient)
    for i in range(size):
        for j in range(size):
            prior.information[i, j] = half[min(i, j), max(i, j)]
    prior.at[:3], prior.at[3:] = pose, rest


@kernel
def sweep(problem: Problem, A: Float, b: Float, work: Pass) -> float:
    """Run the forward pass: compute A and b of a step of the newest pose and the rest.

    Returns the decrease of twice the cost that the noise of the motions achieves without such a step.
    """
    prior, window, observed, _, rest, landmarks = problem
    size = ROBOT + len(rest)
    add_prior(prior, window.pose[0], rest, landmarks, A, b)
    add_kept(problem, A, b)
    for i in range(len(window.pose)):
        if i > 0:
            move_on(window, i, size, A, b, work)
        add_observations(observations_of(observed, i), window.pose[i], 0, rest, A, b)
    fallen = 0.0
    for i in range(1, len(window.pose)):
        noise, pull, Z = noise_at(window, i), work.pull[i], work.root[i]
        fallen += spent(window, i)
        for a in range(3):
            fallen += 2.0 * pull[a] * noise[a] + (Z[a, 0] * pull[0] + Z[a, 1] * pull[1] + Z[a, 2] * pull[2]) ** 2
            for d in range(3):
                fallen += noise[a] * work.row[i, a, d] * noise[d]
    return fallen


@kernel
def move_on(window: Window, i: int, size: int, A: Float, b: Float, work: Pass) -> None:
    """Propagate A and b from pose i - 1 to pose i, and eliminate the noise of the motion between them."""
    before, after = window.pose[i - 1], window.pose[i]
    shear(after[0] - before[0], after[1] - before[1], size, A, b)
    shift, row, pull, Z = noise_at(window, i), work.row[i], work.pull[i], work.root[i]
    for j in range(size):
        for a in range(3):
            row[a, j] = A[min(a, j), max(a, j)]
        b[j] -= row[0, j] * shift[0] + row[1, j] * shift[1] + row[2, j] * shift[2]
    pull[:] = b[:3]
    divided_root(window, i, row, Z)
    answer = np.empty((3, size))
    for a in range(3):
        for j in range(size):
            answer[a, j] = Z[a, 0] * row[0, j] + Z[a, 1] * row[1, j] + Z[a, 2] * row[2, j]
        along = Z[a, 0] * pull[0] + Z[a, 1] * pull[1] + Z[a, 2] * pull[2]
        for j in range(size):
            b[j] -= answer[a, j] * along
    for j in range(size):
        y0, y1, y2 = answer[0, j], answer[1, j], answer[2, j]
        for q in range(j, size):
            A[j, q] -= y0 * answer[0, q] + y1 * answer[1, q] + y2 * answer[2, q]


@inner
def divided_root(window: Window, i: int, row: Float, Z: Float) -> None:
    """Compute Z = U'^-1 L'G' with U'U = I + L'G'A G L; the robot's block of A is in the first columns of `row`."""
    L, heading = window.root[i], window.pose[i - 1, 2]
    c, s = math.cos(heading), math.sin(heading)
    for a in range(3):  # rows of Z are columns of G L
        Z[a, 0], Z[a, 1], Z[a, 2] = c * L[0, a] - s * L[1, a], s * L[0, a] + c * L[1, a], L[2, a]
    U = np.empty((3, 3))
    for a in range(3):
        for d in range(a, 3):
            U[a, d] = 1.0 if a == d else 0.0
            for e in range(3):
                U[a, d] += Z[a, e] * (row[e, 0] * Z[d, 0] + row[e, 1] * Z[d, 1] + row[e, 2] * Z[d, 2])
    for a in range(3):
        for e in range(a):
            for d in range(a, 3):
                U[a, d] -= U[e, a] * U[e, d]
            for d in range(3):
                Z[a, d] -= U[e, a] * Z[e, d]
        pivot = math.sqrt(max(U[a, a], 1.0))  # at least 1, except for rounding
        for d in range(a, 3):
            U[a, d] /= pivot
        for d in range(3):
            Z[a, d] /= pivot


@inner
def shear(east: float, north: float, size: int, A: Float, b: Float) -> None:
    """A <- F^-T A F^-1, b <- F^-T b for F = [I, J lever; 0, 1], on the upper triangle."""
    for j in range(3, size):
        A[2, j] += north * A[0, j] - east * A[1, j]
    with_x = A[0, 2] + north * A[0, 0] - east * A[0, 1]
    with_y = A[1, 2] + north * A[0, 1] - east * A[1, 1]
    A[2, 2] += north * (A[0, 2] + with_x) - east * (A[1, 2] + with_y)
    A[0, 2], A[1, 2] = with_x, with_y
    b[2] += north * b[0] - east * b[1]


@kernel
def solve(size: int, A: Float, b: Float, step: Float, cov: Float) -> bool:
    """Compute the step A^-1 b (size,) and the robot's covariance (3, 3); overwrite A with its Cholesky factor.

    Returns False if A is not positive definite, or if a pivot is only rounding of its diagonal entry (see
    `rounding_limits`).
    """
    before = np.diag(A)[:size].copy()
    if not cholesky(A, size):
        return False
    for i in range(size):
        if not A[i, i] * A[i, i] > LEAST * before[i]:
            return False
    W = np.zeros((size, 4))
    for i in range(size):
        W[i, 3] = b[i]
    for a in range(3):
        W[a, a] = 1.0
    solve_factor(A, W, size, 4)
    for a in range(3):
        for d in range(3):
            cov[a, d] = 0.0
            for i in range(size):
                cov[a, d] += W[i, a] * W[i, d]
    for i in range(size - 1, -1, -1):
        total = W[i, 3]
        for j in range(i + 1, size):
            total -= A[i, j] * step[j]
        step[i] = total / A[i, i]
    return bool(np.isfinite(step[:size]).all())


@kernel
def go_back(window: Window, size: int, step: Float, work: Pass) -> None:
    """Run the backward pass: compute the multipliers that belong to a step of the newest pose and the rest.

    The first three entries of `step` are then the step of x_0.
    """
    open_, noise, asked = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(window.pose) - 1, 0, -1):
        row, Z, heading = work.row[i], work.root[i], window.pose[i - 1, 2]
        shift = noise_at(window, i)
        for a in range(3):
            open_[a] = -work.pull[i, a]
            for j in range(size):
                open_[a] += row[a, j] * step[j]
        noise[:] = 0.0
        for a in range(3):
            along = Z[a, 0] * open_[0] + Z[a, 1] * open_[1] + Z[a, 2] * open_[2]
            for d in range(3):
                noise[d] += Z[a, d] * along
        for a in range(3):
            asked[a] = open_[a] - row[a, 0] * noise[0] - row[a, 1] * noise[1] - row[a, 2] * noise[2]
        c, s = math.cos(heading), math.sin(heading)
        work.step[i, 0] = c * asked[0] + s * asked[1]
        work.step[i, 1] = c * asked[1] - s * asked[0]
        work.step[i, 2] = asked[2]
        step[2] += shift[2] - noise[2]
        step[0] += shift[0] - noise[0] + (window.pose[i, 1] - window.pose[i - 1, 1]) * step[2]
        step[1] += shift[1] - noise[1] - (window.pose[i, 0] - window.pose[i - 1, 0]) * step[2]
