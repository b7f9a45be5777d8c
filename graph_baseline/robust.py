"""The hindsight optimum without outliers.

GTSAM's graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas and Carlone, "Graduated
non-convexity for robust spatial perception", RA-L 5(2), 2020) selects the inliers among the observations. Prior and
odometry are inliers. `batch` then computes the optimum of the inliers.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.hindsight import batch
from slamgauge.graph_baseline.problem.preparation import are_placed, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.solver.gtsam_start import find_inliers
from slamgauge.graph_baseline.solver.motion_elimination import reduce_to_key_poses
from slamgauge.graph_baseline.solver.multistart import first_guess
from slamgauge.recording import Recording

INLIER_PROBABILITY = 0.999  # probability that the cost of a correct observation is below the truncation


@relative_to_start
def robust_batch(recording: Recording, association: Int | None = None) -> Estimate:
    """Return `batch` without the observations that are inconsistent with the others; their `association` is -1.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.

    Raises:
        UserError: as `batch`.
    """
    problem = prepare(recording, association)
    path = problem.dead_reckoning
    placed = are_placed(problem, path)
    seen = problem.only(placed)
    short, key = reduce_to_key_poses(seen)
    poses, landmarks = first_guess(seen)
    inliers = find_inliers(short, poses[key], landmarks, INLIER_PROBABILITY)
    trusted = np.full(len(problem.landmark), -1)
    trusted[np.flatnonzero(placed)[inliers]] = seen.landmark[inliers]
    return with_association(batch(problem, trusted), association)
