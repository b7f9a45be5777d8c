"""Gauss-Newton passes over a window of poses, compiled.

The unknowns are the first pose x_0 of the window, the noise w_i of each later motion, and the rest: landmarks, then
older poses that are kept. The path is a function of these, x_i = x_{i-1} (+) (u_i + w_i), so that a motion without
lateral noise never slips. Noise is stored by its multiplier m_i, w_i = Q_i m_i, which is finite even if Q is singular.

A pass is an information filter that runs forward through the window, with all Jacobians at the present estimate. A and
b define the cost 1/2 d'A d - b'd of a step d of the newest pose so far and of the rest. From one pose to the next,
d_i = F d_{i-1} - G w_i + G w. The information is propagated, A <- F^-T A F^-1, then w is eliminated: A <- A - A Z'Z A
with Z = U'^-1 L'G', Q = LL' and U'U = I + L'G'A G L. `Pass` stores the intermediate results, from which a backward pass
computes the multipliers of all motions.

The information of marginalised poses is a prior on right-invariant errors xi of x_0 and the rest:
p = R(xi_theta) p_ref + V(xi_theta) xi_p for the robot and every landmark, V(t) = (R(t) - I) / (t J), and
heading - heading_ref = xi_theta. For a kept pose, xi_theta is its rotation relative to x_0. A translation or rotation
of the whole map has the same coordinates in these errors at every estimate. The errors refer to the present estimate
of x_0 and the rest: a step moves the reference and keeps the information (`rebase`), as in the right-invariant filter.
Therefore relinearisation adds no information about a translation or rotation of the whole map.

Sources: Sibley, Matthies and Sukhatme, "Sliding window filter with application to planetary landing", Journal of Field
Robotics 27(5), 2010; Barrau and Bonnabel, arXiv 1510.06263 (the errors); Dong-Si and Mourikis, "Motion tracking with
fixed-lag smoothing: algorithm and consistency analysis", ICRA 2011 (inconsistency without them).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.blas import cholesky, solve_factor
from slamgauge.ekf.kernels.rounding_limits import LEAST
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import mean_rotation, wrap
from slamgauge.sensor_kernels import observe, wrap_innovation


class Prior(NamedTuple):
    """Prior from before the window on n errors: of its first pose, of landmarks, and of kept poses."""

    information: Float  # (n, n), both triangles
    gradient: Float  # (n,)
    at: Float  # (n,) reference, at which the errors are zero


class Observed(NamedTuple):
    """Observations of landmarks."""

    sensor: int  # its code in `slamgauge.sensors.SENSORS`
    slot: Int  # (m,) landmark, -1 while its position is unknown
    value: Float  # (m, 2)
    root: Float  # (m, 2, 2) upper, root'root is the inverse covariance; the first row is zero for bearing-only sensors


class ObservedByPose(NamedTuple):
    """Observations of several poses: rows first[i] to first[i + 1] belong to pose i."""

    first: Int  # (poses + 1,)
    rows: Observed


class Window(NamedTuple):
    """Poses x_0, ..., x_k and the motions between them; entry i is the motion from pose i - 1 to pose i."""

    pose: Float  # (k+1, 3)
    multiplier: Float  # (k+1, 3)
    increment: Float  # (k+1, 3)
    root: Float  # (k+1, 3, 3) L of the increment's covariance Q = L L', with orthogonal columns


class Problem(NamedTuple):
    """Measurements and unknowns of a window."""

    prior: Prior
    window: Window
    observed: ObservedByPose  # observations of the window's poses
    kept: ObservedByPose  # observations of the kept poses
    rest: Float  # (n-3,) landmarks (L, 2), then kept poses (K, 3)
    landmarks: int  # L


class Pass(NamedTuple):
    """Intermediate results of the forward pass for each motion, for the backward pass; n unknowns."""

    row: Float  # (k+1, 3, n) the robot's rows of A before w is eliminated
    pull: Float  # (k+1, 3) the robot's entries of b before w is eliminated
    root: Float  # (k+1, 3, 3) Z
    step: Float  # (k+1, 3) resulting multipliers


def allocate_pass(poses: int, unknowns: int) -> Pass:
    """Allocate the arrays of a pass."""
    return Pass(np.zeros((poses, 3, unknowns)), np.zeros((poses, 3)), np.zeros((poses, 3, 3)), np.zeros((poses, 3)))


# --- parts of the cost, with their Jacobians -------------------------------------------------------


@kernel
def prior_error(prior: Prior, pose: Float, rest: Float, landmarks: int, error: Float) -> None:
    """Fill `error` (n,) with the right-invariant errors of a first pose and the rest."""
    at = prior.at
    turn = wrap(pose[2] - at[2])
    c, s = math.cos(turn), math.sin(turn)
    along, across = mean_rotation(turn)
    squared = along * along + across * across
    points = ROBOT + 2 * landmarks
    i = 0
    while i < len(error):
        x, y = (pose[0], pose[1]) if i == 0 else (rest[i - ROBOT], rest[i - ROBOT + 1])
        east, north = x - (c * at[i] - s * at[i + 1]), y - (s * at[i] + c * at[i + 1])
        error[i], error[i + 1] = (along * east + across * north) / squared, (along * north - across * east) / squared
        i += 2
        if i == 2:
            error[i] = turn
            i += 1
        elif i > points:
            error[i] = wrap(rest[i - ROBOT] - at[i] - turn)
            i += 1


@kernel
def heading_lever(pose: Float, rest: Float, landmarks: int, lever: Float) -> None:
    """Fill `lever` (n,) with the derivatives by a rotation of the whole map: J p for points, 1 for headings."""
    points = ROBOT + 2 * landmarks
    lever[0], lever[1], lever[2] = -pose[1], pose[0], 1.0
    i = ROBOT
    while i < len(lever):
        lever[i], lever[i + 1] = -rest[i - ROBOT + 1], rest[i - ROBOT]
        i += 2
        if i > points:
            lever[i] = 1.0
            i += 1


@kernel
def observations_of(observed: ObservedByPose, pose: int) -> Observed:
    """Return the observations of one pose, as views."""
    rows, part = observed.rows, slice(observed.first[pose], observed.first[pose + 1])
    return Observed(rows.sensor, rows.slot[part], rows.value[part], rows.root[part])


@kernel
def observation_error(observed: Observed, row: int, pose: Float, landmark: Float, r: Float, H: Float) -> None:
    """Fill the residual r (2,) of an observation, in standard deviations, and its Jacobian H (2, 5).

    The columns of H are x, y and heading of the pose, and x and y of the landmark: a step d changes r to r + H d.
    """
    sensor, value, root = observed.sensor, observed.value[row], observed.root[row]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    east, north = landmark[0] - pose[0], landmark[1] - pose[1]
    dx, dy = c * east + s * north, c * north - s * east
    z0, z1, a00, a01, a10, a11 = observe(sensor, dx, dy)
    v0, v1 = z0 - value[0], wrap_innovation(sensor, 1, z1 - value[1])
    if a10 == 0.0 and a11 == 0.0:  # the landmark is too close: its bearing has no information
        v1 = 0.0
    if a00 == 0.0 and a01 == 0.0:
        v0 = 0.0
    for i in range(2):
        w0, w1 = root[i, 0], root[i, 1]
        r[i] = w0 * v0 + w1 * v1
        ax, ay = w0 * a00 + w1 * a10, w0 * a01 + w1 * a11
        H[i, 3], H[i, 4] = ax * c - ay * s, ax * s + ay * c
        H[i, 0], H[i, 1] = -H[i, 3], -H[i, 4]
        H[i, 2] = ax * dy - ay * dx


@kernel
def cost(problem: Problem) -> float:
    """Return twice the cost of the window, up to a constant."""
    prior, window, observed, kept, rest, landmarks = problem
    size = ROBOT + len(rest)
    error = np.empty(size)
    prior_error(prior, window.pose[0], rest, landmarks, error)
    total = 0.0
    for i in range(size):
        pull = 0.0
        for j in range(size):
            pull += prior.information[i, j] * error[j]
        total += error[i] * (pull - 2.0 * prior.gradient[i])
    r, H = np.empty(2), np.empty((2, 5))
    for i in range(len(window.pose)):
        if i > 0:
            total += spent(window, i)
        for row in range(observed.first[i], observed.first[i + 1]):
            total += _squared(observed.rows, row, window.pose[i], rest, r, H)
    for j in range(len(kept.first) - 1):
        for row in range(kept.first[j], kept.first[j + 1]):
            total += _squared(kept.rows, row, rest[2 * landmarks + 3 * j :], rest, r, H)
    return total


@inner
def _squared(observed: Observed, row: int, pose: Float, rest: Float, r: Float, H: Float) -> float:
    """Return the squared residual of an observation, 0 if the landmark's position is unknown."""
    slot = observed.slot[row]
    if slot < 0:
        return 0.0
    observation_error(observed, row, pose, rest[2 * slot : 2 * slot + 2], r, H)
    return r[0] * r[0] + r[1] * r[1]


# --- the pass ------------------------------------------------------------------------------------


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
def rebase(prior: Prior, pose: Float, rest: Float, landmarks: int) -> None:
    """Move the reference of the prior's errors to the present first pose and rest."""
    size = ROBOT + len(rest)
    error = np.empty(size)
    prior_error(prior, pose, rest, landmarks, error)
    for i in range(size):
        for j in range(size):
            prior.gradient[i] -= prior.information[i, j] * error[j]
    prior.at[:3], prior.at[3:] = pose, rest


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
def noise_at(window: Window, i: int) -> tuple[float, float, float]:
    """Return the present noise G L L'm of motion i in the world frame."""
    L, m, heading = window.root[i], window.multiplier[i], window.pose[i - 1, 2]
    c, s = math.cos(heading), math.sin(heading)
    x, y, turn = 0.0, 0.0, 0.0
    for a in range(3):
        along = L[0, a] * m[0] + L[1, a] * m[1] + L[2, a] * m[2]
        x += L[0, a] * along
        y += L[1, a] * along
        turn += L[2, a] * along
    return c * x - s * y, s * x + c * y, turn


@inner
def spent(window: Window, i: int) -> float:
    """Return twice the cost of the noise of motion i, m'Q m."""
    L, m = window.root[i], window.multiplier[i]
    total = 0.0
    for a in range(3):
        total += (L[0, a] * m[0] + L[1, a] * m[1] + L[2, a] * m[2]) ** 2
    return total


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


@kernel
def chain(window: Window) -> None:
    """Recompute the path from its first pose, the increments and their noise."""
    for i in range(1, len(window.pose)):
        before, u, noise = window.pose[i - 1], window.increment[i], noise_at(window, i)
        c, s = math.cos(before[2]), math.sin(before[2])
        window.pose[i, 0] = before[0] + c * u[0] - s * u[1] + noise[0]
        window.pose[i, 1] = before[1] + s * u[0] + c * u[1] + noise[1]
        window.pose[i, 2] = wrap(before[2] + u[2] + noise[2])


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
