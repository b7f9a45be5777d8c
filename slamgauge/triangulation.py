"""A landmark from its bearings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.se2 import wrap

GAUSS_NEWTON_STEPS = 8
GRID = 1024.0  # [m] between places that are worked from: differences from them are exact
FOUND = 0.1  # standard deviations: a landmark that moves less has been found


class Triangulation(NamedTuple):
    """A landmark (2,) [m] from its bearings, and its largest standard deviation [m], poses taken as exact."""

    landmark: Float
    sigma: float
    placed: bool


def triangulate(poses: Float, bearings: Float, variances: Float, sure: float) -> Triangulation:
    """The landmark of largest likelihood: Gauss-Newton from the least squares on distances from the lines of sight.

    Args:
        poses: (n, 3) that saw the landmark.
        bearings: (n,) [rad] in the body frame.
        variances: (n,) [rad^2].
        sure: largest standard deviation of a landmark that is `placed`, as a share of its distance.

    Returns:
        The landmark; one that is placed lies in front of the poses.
    """
    angle = poses[:, 2] + bearings
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    gradient = np.column_stack([-along[:, 1], along[:, 0]])
    origin = GRID * np.round(poses[0, :2] / GRID)  # what is far away would swallow the digits of what is near
    places = poses[:, :2] - origin
    residual = (gradient * places).sum(axis=1)
    landmark, sigma, step, offset, squared = np.zeros(2), np.inf, np.inf, along, np.ones(len(poses))
    for _ in range(GAUSS_NEWTON_STEPS):
        weighted = gradient / variances[:, None]
        information = weighted.T @ gradient
        weakest = float(np.linalg.eigvalsh(information)[0])
        if not weakest > 1e-12 * float(np.trace(information)):
            return Triangulation(poses[-1, :2] + along[-1], np.inf, placed=False)
        move = np.linalg.solve(information, weighted.T @ residual)
        landmark = landmark + move
        sigma, step = 1.0 / np.sqrt(weakest), float(np.hypot(*move))
        offset = landmark - places
        squared = np.maximum((offset**2).sum(axis=1), 1e-6)
        gradient = np.column_stack([-offset[:, 1], offset[:, 0]]) / squared[:, None]
        residual = wrap(angle - np.arctan2(offset[:, 1], offset[:, 0]))
    ahead = float(np.mean((offset * along).sum(axis=1) > 0.0))
    settled = step < FOUND * sigma < FOUND * sure * float(np.sqrt(squared.min()))
    return Triangulation(origin + landmark, sigma, placed=bool(ahead > 0.5 and settled))
