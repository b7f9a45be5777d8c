"""The cost of a window of poses, and the Jacobians of its parts, compiled.

The unknowns are the first pose x_0 of the window, the noise w_i of each later motion, and the rest: landmarks, then
older poses that are kept. The path is a function of these, x_i = x_{i-1} (+) (u_i + w_i), so that a motion without
lateral noise never slips. Noise is stored by its multiplier m_i, w_i = Q_i m_i, which is finite even if Q is singular.

The information of marginalised poses is a prior on right-invariant errors xi of x_0 and the rest:
p = R(xi_theta) p_ref + V(xi_theta) xi_p for the robot and every landmark, V(t) = (R(t) - I) / (t J), and
heading - heading_ref = xi_theta. For a kept pose, xi_theta is its rotation relative to x_0. A translation or rotation
of the whole map has the same coordinates in these errors at every estimate. The errors refer to the present estimate
of x_0 and the rest: a step moves the reference and keeps the information (`rebase`), as in the right-invariant filter.
Therefore relinearisation adds no information about a translation or rotation of the whole map.

Sources: Barrau and Bonnabel, arXiv 1510.06263 (the errors); Dong-Si and Mourikis, "Motion tracking with fixed-lag
smoothing: algorithm and consistency analysis", ICRA 2011 (inconsistency without them).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
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
def twice_cost(problem: Problem) -> float:
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
