"""Robust fit of a recording with outliers: graduated non-convexity with the Geman-McClure loss.

An observation with squared Mahalanobis residual d2 gets the weight (c / (c + d2))^2. The first c exceeds all residuals,
so that nearly all observations count equally; then it decreases to the limit of outliers, and these lose their weight.
A few damped steps adapt path and map to each c. The start is dead reckoning with each landmark at the median of the
positions that its observations give, so that misread ids do not move landmarks.

Source: Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", RA-L 5(2), 2020.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.solver.levenberg_marquardt import damped_descent
from slamgauge.recording import Recording

OUTLIER = 1e-3  # probability that a correct observation has a larger residual than the limit of outliers
DECREASE = 4.0  # factor between successive c
LARGEST_SQUARE = 1e12  # largest squared residual; larger ones also have no weight
STEPS = 3  # damped steps for each c


class RobustFit(NamedTuple):
    """Poses (N+1, 3), landmarks (L, 2) in increasing id order, and squared Mahalanobis residuals (M,)."""

    poses: Float
    landmarks: Float
    squared: Float


def robust_fit(problem: Problem) -> RobustFit:
    """Return path and map that fit most observations."""
    objective, poses = Objective(problem), problem.dead_reckoning
    landmarks = landmarks_at_median(problem, poses)
    limit = outlier_limit(problem)
    squared = squared_residuals(objective, poses, landmarks)
    c = 2.0 * float(squared.max(initial=limit))
    while c > limit:
        c = max(c / DECREASE, limit)
        weight = np.square(c / (c + squared))
        weighted = replace(problem, observation_cov=problem.observation_cov / weight[:, None, None])
        poses, landmarks = damped_descent(Objective(weighted), poses, landmarks, STEPS)[:2]
        squared = squared_residuals(objective, poses, landmarks)
    return RobustFit(poses, landmarks, squared)


def outlier_limit(problem: Recording) -> float:
    """Return the squared Mahalanobis residual above which an observation is an outlier."""
    return float(chdtri(problem.observation.shape[1], OUTLIER))


def squared_residuals(objective: Objective, poses: Float, landmarks: Float) -> Float:
    """Return squared Mahalanobis residuals (M,) of the observations; larger or undefined ones are LARGEST_SQUARE."""
    return np.fmin(objective.squared_residuals(objective.at(poses, landmarks)), LARGEST_SQUARE)
