"""GTSAM's batch solution of a recording: initial values, graph, Levenberg-Marquardt, marginal covariances.

`batch` solves the same problem without the approximations listed in `gtsam_batch`. A test compares both on every
shipped scenario.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_graph import REGULARISING_NOISE, build_graph, covariance_in_world, read_values
from slamgauge.graph_baseline.gtsam_isam2 import Isam2Solver
from slamgauge.graph_baseline.problem.preparation import prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording

RELATIVE_ERROR, ABSOLUTE_ERROR = 1e-12, 1e-8  # changes of the cost at which Levenberg-Marquardt stops
START_NOISE = 0.1  # regularising noise of the initial values: 3 mm for the exercise's robot


@relative_to_start
def gtsam_batch(recording: Recording, association: Int | None = None) -> Estimate:
    """Return GTSAM's maximum a posteriori path and map given all measurements, with their marginal covariances.

    Differences from the exact optimum, because of limits of GTSAM:

    - Levenberg-Marquardt stops early with constraints. Therefore a direction of zero variance gets regularising noise
      of 1/300 of the largest standard deviation of its step. On the shipped scenarios this moves poses by less than
      0.0006 of their standard deviation, and changes standard deviations by less than 0.01 %.
    - An observation of the `position` sensor becomes a range and a bearing, with the covariance converted at the
      measured point. On `ukfm-slam2d` this moves poses by up to 0.05 standard deviations.
    - A bearing-only landmark is added when its bearings place it from iSAM2's path. Landmarks that they never place,
      for example with a single bearing, are not in the graph; their `association` is -1.
    - Levenberg-Marquardt converges to the minimum near iSAM2's estimate. `batch` tries several starts.
    - `Marginals` is slow for large maps: about 50 s and 0.5 GB for 300 landmarks and 1257 poses. Levenberg-Marquardt
      takes 4 s for the same recording, and `batch` 5 s in total.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.

    Raises:
        UserError: the association is unknown, or the measurements leave a variable undetermined.
    """
    problem = prepare(recording, association)
    with explained():
        # iSAM2's estimate gives the initial values. Dead reckoning leads to another minimum if it drifts far
        # (ukfm-slam2d). GTSAM's default factorisation (Cholesky) is fast, but needs larger regularising noise.
        solver = Isam2Solver(problem, gtsam.ISAM2Params(), START_NOISE)
        for k in range(problem.steps + 1):
            solver.add_step(k)
        initial, landmark_ids, used = solver.isam.calculateEstimate(), solver.landmark_ids, solver.association

        graph = build_graph(problem.associated(used), REGULARISING_NOISE)

        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setRelativeErrorTol(RELATIVE_ERROR)
        parameters.setAbsoluteErrorTol(ABSOLUTE_ERROR)
        result = gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters).optimize()

        marginals = gtsam.Marginals(graph, result)
        poses, landmarks = read_values(result)
        pose_covs = [
            covariance_in_world(heading, marginals.marginalCovariance(X(k))) for k, heading in enumerate(poses[:, 2])
        ]
        landmark_covs = [marginals.marginalCovariance(L(name)) for name in landmark_ids.tolist()]
    estimate = Estimate(
        kind="smoothed",
        poses=poses,
        pose_covs=without_negative_eigenvalues(np.array(pose_covs)),
        landmark_ids=landmark_ids,
        landmarks=landmarks,
        landmark_covs=without_negative_eigenvalues(np.array(landmark_covs).reshape(-1, 2, 2)),
        association=used,
    )
    return with_association(estimate, association)
