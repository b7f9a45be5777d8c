"""Robust fit of a recording with outliers: graduated non-convexity with the Geman-McClure loss.

An observation with squared Mahalanobis residual d2 gets the weight (c / (c + d2))^2. The first c exceeds all residuals,
so that nearly all observations count equally; then it decreases to `OUTLIER`, and the outliers lose their weight. A few
damped steps adapt path and map to each c. The start is dead reckoning with each landmark at the median of the positions
that its observations give, so that misread ids do not move landmarks.

Source: Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", RA-L 5(2), 2020.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from slamgauge.arrays import Float, Int, Marks
from slamgauge.graph_baseline.problem.linearisation import whitened_residuals
from slamgauge.graph_baseline.problem.preparation import Problem, in_frame_of_start, landmarks_at_median, prepare
from slamgauge.graph_baseline.solver.levenberg_marquardt import damped_descent
from slamgauge.recording import Recording

OUTLIER = 1e-3  # probability that a correct observation has a larger residual than the limit of outliers
DECREASE = 4.0  # factor between successive c
LARGEST = 1e12  # largest squared residual; larger ones also have no weight
STEPS = 3  # damped steps for each c


class RobustFit(NamedTuple):
    """Poses (N+1, 3), landmarks (L, 2) in increasing id order, and squared Mahalanobis residuals (M,)."""

    poses: Float
    landmarks: Float
    squared: Float
    limit: float  # of the squared residuals of inliers

    @property
    def inliers(self) -> Marks:
        """Return a mask (M,) of the observations that fit path and map."""
        return self.squared < self.limit


def robust_fit(recording: Problem) -> RobustFit:
    """Return path and map that fit most observations of a sensor that places landmarks."""
    poses = recording.dead_reckoning
    landmarks = landmarks_at_median(recording, poses)
    limit = float(chdtri(recording.observation.shape[1], OUTLIER))
    squared = _squared_residuals(recording, poses, landmarks)
    c = 2.0 * float(squared.max(initial=limit))
    while c > limit:
        c = max(c / DECREASE, limit)
        weight = np.square(c / (c + squared))
        weighted = replace(recording, observation_cov=recording.observation_cov / weight[:, None, None])
        poses, landmarks = damped_descent(weighted, poses, landmarks, STEPS)[:2]
        squared = _squared_residuals(recording, poses, landmarks)
    return RobustFit(poses, landmarks, squared, limit)


def rejected_observations(recording: Recording) -> Int:
    """Return the rows (R,) of the observations that do not fit, the largest residuals first.

    Args:
        recording: known association, and a sensor that places landmarks.
    """
    fit = robust_fit(prepare(in_frame_of_start(recording)))
    rows = np.flatnonzero(~fit.inliers)
    return rows[np.argsort(-fit.squared[rows], kind="stable")]


def _squared_residuals(recording: Problem, poses: Float, landmarks: Float) -> Float:
    """Return the squared Mahalanobis residuals (M,) of the observations, LARGEST if they are larger or undefined."""
    with np.errstate(all="ignore"):
        squared = np.square(whitened_residuals(recording, recording.slot, poses, landmarks)).sum(axis=1)
    return np.fmin(squared, LARGEST)
