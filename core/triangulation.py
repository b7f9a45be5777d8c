"""A landmark from its bearings."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.jit import kernel

GAUSS_NEWTON_STEPS = 8
GRID = 1024.0  # m; the origin of the computation is a multiple of this, so that differences from it are exact
FOUND = 0.1  # standard deviations; a smaller step ends the search


class Triangulation(NamedTuple):
    """A landmark (2,) [m], its largest standard deviation [m] if the poses are exact, and whether it is `placed`."""

    landmark: Float
    sigma: float
    placed: bool


def triangulate(poses: Float, bearings: Float, variances: Float, sure: float) -> Triangulation:
    """Return the maximum likelihood landmark: Gauss-Newton, started at the point nearest to all bearing lines.

    Args:
        poses: (n, 3) of the bearings.
        bearings: (n,) [rad] in the body frame.
        variances: (n,) [rad^2].
        sure: largest standard deviation of a `placed` landmark, as a share of its distance.

    Returns:
        The landmark. If it is `placed`, it lies in front of the poses.
    """
    given = np.ascontiguousarray(poses), np.ascontiguousarray(bearings), np.ascontiguousarray(variances)
    x, y, sigma, step, nearest, ahead = _searched(*given)
    settled = step < FOUND * sigma < FOUND * sure * nearest
    return Triangulation(np.array([x, y]), sigma, placed=bool(ahead > 0.5 and settled))


@kernel
def _searched(poses: Float, bearings: Float, variances: Float) -> tuple[float, float, float, float, float, float]:
    """Run Gauss-Newton; without a solution return infinite sigma and a point 1 m from the last pose.

    Returns x, y, their largest standard deviation, the length of the last step, the distance of the nearest pose [m],
    and the share of poses that have the landmark in front.
    """
    count = len(poses)
    origin_x, origin_y = GRID * np.round(poses[0, 0] / GRID), GRID * np.round(poses[0, 1] / GRID)
    angle, residual = poses[:, 2] + bearings, np.empty(count)
    along, gradient = np.empty((count, 2)), np.empty((count, 2))
    for i in range(count):
        along[i, 0], along[i, 1] = math.cos(angle[i]), math.sin(angle[i])
        gradient[i, 0], gradient[i, 1] = -along[i, 1], along[i, 0]
        residual[i] = gradient[i, 0] * (poses[i, 0] - origin_x) + gradient[i, 1] * (poses[i, 1] - origin_y)
    x, y, sigma, step, nearest, ahead = 0.0, 0.0, math.inf, math.inf, math.inf, 0.0
    for _ in range(GAUSS_NEWTON_STEPS):
        a, b, d, pull_x, pull_y = 0.0, 0.0, 0.0, 0.0, 0.0  # information matrix [[a, b], [b, d]] and vector
        for i in range(count):
            g, h = gradient[i, 0] / variances[i], gradient[i, 1] / variances[i]
            a += g * gradient[i, 0]
            b += g * gradient[i, 1]
            d += h * gradient[i, 1]
            pull_x += g * residual[i]
            pull_y += h * residual[i]
        strongest = 0.5 * (a + d + math.hypot(a - d, 2.0 * b))
        weakest = (a * d - b * b) / strongest
        if not weakest > 1e-12 * (a + d):
            x, y = poses[-1, 0] + along[-1, 0], poses[-1, 1] + along[-1, 1]
            return x, y, math.inf, math.inf, 0.0, 0.0
        determinant = strongest * weakest
        move_x, move_y = (d * pull_x - b * pull_y) / determinant, (a * pull_y - b * pull_x) / determinant
        x, y = x + move_x, y + move_y
        sigma, step = 1.0 / math.sqrt(weakest), math.hypot(move_x, move_y)
        nearest, ahead = math.inf, 0.0
        for i in range(count):
            east, north = x - (poses[i, 0] - origin_x), y - (poses[i, 1] - origin_y)
            squared = max(east * east + north * north, 1e-6)
            nearest = min(nearest, squared)
            forward, left = along[i, 0] * east + along[i, 1] * north, along[i, 0] * north - along[i, 1] * east
            ahead += (forward > 0.0) / count
            gradient[i, 0], gradient[i, 1] = -north / squared, east / squared
            residual[i] = -math.atan2(left, forward)
    return origin_x + x, origin_y + y, sigma, step, math.sqrt(nearest), ahead
