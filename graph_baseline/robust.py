"""The hindsight optimum of those observations that agree: what outlier rejection buys.

GTSAM's graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas and Carlone, "Graduated
non-convexity for robust spatial perception", RA-L 5(2), 2020) decides which observations to trust; prior and
odometry always are. Those that it rejects are left out, and `batch` solves for the rest exactly.
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

TRUSTED = 0.999  # probability with which a true observation's cost stays below the truncation


@relative_to_start
def robust_batch(recording: Recording, association: Int | None = None) -> Estimate:
    """`batch` without the observations that do not fit the others; their `association` is -1.

    Args:
        recording: what was measured.
        association: (M,) ids in place of the recording's own; -1 leaves an observation out.

    Raises:
        UserError: as `batch`; or there is no GTSAM on this system.
    """
    problem = prepare(recording, association)
    path = problem.dead_reckoning
    placed = are_placed(problem, path)
    seen = problem.only(placed)
    short, key = reduce_to_key_poses(seen)
    poses, landmarks = first_guess(seen)
    inliers = find_inliers(short, poses[key], landmarks, TRUSTED)
    trusted = np.full(len(problem.landmark), -1)
    trusted[np.flatnonzero(placed)[inliers]] = seen.landmark[inliers]
    return with_association(batch(problem, trusted), association)
