"""The exact cost of a recording, which the optima minimise, and its linear model.

The cost is half the sum of squared whitened residuals, which GTSAM calls the error. Zero variances are constraints.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans, empty_model, graph_arrays, linearise
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.problem.retraction import MotionNoise
from slamgauge.recording import Recording

VIOLATED = 1e-6  # m or rad; a motion that leaves the range of its noise by more has an infinite cost


class Point(NamedTuple):
    """A path and a map, with the cost and the linear model there."""

    poses: Float  # (N+1, 3)
    landmarks: Float  # (L, 2), ids increasing
    cost: float
    model: LinearModel


class Objective:
    """The cost of paths and maps of a problem that satisfy the constraints of zero variances.

    Attributes:
        problem: as given.
        noise: of start and motions.
        arrays: the problem as arrays for kernels.
        scans: observations by pose.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.noise, self.arrays = problem, MotionNoise(problem), graph_arrays(problem)
        self.scans = Scans(self.arrays.first, self.arrays.slot)

    def at(self, poses: Float, landmarks: Float) -> Point:
        """Return poses (N+1, 3) and landmarks (L, 2) with cost and model; an undefined cost is infinite."""
        model = empty_model(len(poses), *self.arrays.value.shape)
        linearise(self.arrays, poses, landmarks, (0, len(poses)), model)
        with np.errstate(all="ignore"):
            cost = self.noise.cost(poses) + 0.5 * float(np.square(model.r).sum())
        return Point(poses, landmarks, cost if np.isfinite(cost) else np.inf, model)

    def squared_residuals(self, point: Point) -> Float:
        """Return the squared Mahalanobis residuals (M,) of the observations; they may be infinite or undefined."""
        with np.errstate(all="ignore"):
            return np.square(point.model.r).sum(axis=1)


def cost(recording: Recording, poses: Float, landmark_ids: Int, landmarks: Float) -> float:
    """Return half the sum of squared whitened residuals of the exact model, which GTSAM calls the error.

    It is infinite if a motion violates a zero variance by more than 1e-6 (m or rad). `landmark_ids` must contain every
    landmark of the recording.
    """
    objective = Objective(prepare(recording))
    order = np.argsort(landmark_ids)
    used = order[np.searchsorted(landmark_ids, objective.problem.landmark_ids, sorter=order)]
    poses = np.array(poses, dtype=np.float64)
    if objective.noise.violation(poses) > VIOLATED:
        return np.inf
    return objective.at(poses, np.array(landmarks, dtype=np.float64)[used]).cost
