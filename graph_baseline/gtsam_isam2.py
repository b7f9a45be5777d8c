"""GTSAM's iSAM2 on a recording, step by step: the newest pose and its covariance after every step.

iSAM2 stores the square-root information matrix as a Bayes tree and updates the part that a new scan affects. Every
`relinearize_skip` updates it relinearises the variables that have moved by more than `relinearize_threshold`.

Source: Kaess et al., "iSAM2: Incremental smoothing and mapping using the Bayes tree", IJRR 31(2), 2012.
"""

from __future__ import annotations

from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.gtsam_conversions import covariance_in_world, pose_array, read_values
from slamgauge.graph_baseline.gtsam_incremental import IncrementalGraph
from slamgauge.graph_baseline.problem.preparation import prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording
from slamgauge.se2 import compose

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
    """Return the newest pose of iSAM2 at every step, and the final map.

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
    problem, steps = prepare(recording, association), recording.steps
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(relinearize_threshold)
    parameters.relinearizeSkip = relinearize_skip
    # Cholesky loses the digits of regularising noise: q1-long-sparse would fail at step 297.
    parameters.setFactorization("QR")
    isam = gtsam.ISAM2(parameters)
    graph = IncrementalGraph(problem, motion_factors(problem), observation_factors(problem))
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)

    def pose(step: int) -> Float:
        return pose_array(isam.calculateEstimatePose2(X(step)))

    with explained():
        for k in range(steps + 1):
            start = perf_counter()
            poses[k] = compose(poses[k - 1], problem.odometry[k - 1]) if k else problem.prior_mean
            isam.update(*graph.add_steps(k, k + 1, poses))
            placed, values = graph.add_waiting(k, k + 1, pose)
            if placed.size():
                isam.update(placed, values)
            poses[k] = pose(k)
            pose_covs[k] = covariance_in_world(poses[k, 2], isam.marginalCovariance(X(k)))
            seconds[k] = perf_counter() - start
        ids = sorted(graph.mapped)
        landmark_covs = np.array([isam.marginalCovariance(L(name)) for name in ids])
    estimate = Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=without_negative_eigenvalues(pose_covs),
        landmark_ids=np.array(ids, dtype=np.int64),
        landmarks=read_values(isam.calculateEstimate())[1],
        landmark_covs=without_negative_eigenvalues(landmark_covs.reshape(-1, 2, 2)),
        association=np.where(graph.used, problem.landmark, -1),
        seconds=seconds,
    )
    return with_association(estimate, association)
