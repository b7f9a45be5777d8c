"""The hindsight optimum without outliers.

Graduated non-convexity (`robust_fit`) selects the inliers among the observations. `batch` computes their optimum, and
the observations that fit it are the next inliers, until they do not change: a local minimum of truncated least squares.
Prior and odometry are inliers.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.hindsight import batch
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import are_placed
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.solver.robust_fit import outlier_limit, robust_fit, squared_residuals
from slamgauge.recording import Recording

MOST_ROUNDS = 10  # rounds of optimum and selection; observations near the limit may be selected in turn


@relative_to_start
def robust_batch(recording: Recording, association: Int | None = None) -> Estimate:
    """Return `batch` without the observations that are inconsistent with the others; their `association` is -1.

    An observation is an outlier if its squared Mahalanobis residual is above the 0.999 quantile of chi-square.
    Source: graduated non-convexity (Yang et al., RA-L 5(2), 2020).

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.

    Raises:
        UserError: as `batch`.
    """
    problem = prepare(recording, association)
    placed = are_placed(problem, problem.dead_reckoning)
    fits = np.zeros(len(placed), dtype=bool)
    fits[placed] = robust_fit(problem.only(placed)).squared < outlier_limit(problem)
    found = batch(problem, np.where(fits, problem.landmark, -1))
    for _ in range(MOST_ROUNDS):
        before, fits = fits, _fit(problem, found)
        if np.array_equal(fits, before):
            break
        found = batch(problem, np.where(fits, problem.landmark, -1))
    return with_association(found, association)


def _fit(problem: Problem, optimum: Estimate) -> Marks:
    """Return a mask (M,) of the observations that fit an optimum, of landmarks in its map."""
    mapped = np.isin(problem.landmark, optimum.landmark_ids)
    squared = squared_residuals(Objective(problem.only(mapped)), optimum.poses, optimum.landmarks)
    fits = np.zeros(len(mapped), dtype=bool)
    fits[mapped] = squared < outlier_limit(problem)
    return fits
