"""GTSAM's iSAM2 on a recording, step by step: the newest pose and its covariance after every step.

iSAM2 stores the square-root information matrix as a Bayes tree and updates the part that a new scan affects. Every
`relinearize_skip` updates it relinearises the variables that have moved by more than `relinearize_threshold`.

Source: Kaess et al., "iSAM2: Incremental smoothing and mapping using the Bayes tree", IJRR 31(2), 2012.
"""

from __future__ import annotations

import gtsam

from slamgauge.arrays import Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.gtsam_incremental import IncrementalGraph, newest_poses
from slamgauge.graph_baseline.problem.preparation import prepare, relative_to_start, with_association
from slamgauge.recording import Recording

# GTSAM's defaults
RELINEARIZE_THRESHOLD = 0.1  # m or rad
RELINEARIZE_SKIP = 10  # updates


@relative_to_start
def isam2(
    recording: Recording,
    association: Int | None = None,
    relinearize_threshold: float = RELINEARIZE_THRESHOLD,
    relinearize_skip: int = RELINEARIZE_SKIP,
) -> Estimate:
    """Return the newest pose of iSAM2 (Kaess et al., IJRR 31(2), 2012) at every step, and the final map.

    `causal` computes the same quantity at the minimum of the exact cost; iSAM2 stops at its relinearisation threshold.

    Because of limits of GTSAM, directions of zero variance get regularising noise, and observed positions become range
    and bearing (`gtsam_batch`). A bearing-only landmark is added when its bearings place it; the `association` of a
    landmark that they never place is -1.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.
        relinearize_threshold: a variable that has moved by more than this is relinearised, m or rad.
        relinearize_skip: number of updates from one relinearisation to the next, at least 1.

    Raises:
        UserError: the association is unknown, or the measurements leave a variable undetermined.
    """
    problem = prepare(recording, association)
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(relinearize_threshold)
    parameters.relinearizeSkip = relinearize_skip
    # Cholesky loses the digits of regularising noise: q1-long-sparse would fail at step 297.
    parameters.setFactorization("QR")
    isam = gtsam.ISAM2(parameters)
    graph = IncrementalGraph(problem, motion_factors(problem), observation_factors(problem))

    def update(_: int, factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        isam.update(factors, values)

    return with_association(newest_poses(graph, isam, update), association)
