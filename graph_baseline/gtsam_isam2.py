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
from slamgauge.graph_baseline.gtsam_graph import (
    REGULARISING_NOISE,
    IncrementalGraph,
    covariance_in_world,
    pose_array,
    read_values,
)
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
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
    and bearing (`gtsam_graph`). A bearing-only landmark is added when its bearings place it; the `association` of a
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
    solver, steps = Isam2Solver(problem, parameters), problem.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    with explained():
        for k in range(steps + 1):
            start = perf_counter()
            poses[k] = solver.add_step(k)
            pose_covs[k] = covariance_in_world(poses[k, 2], solver.isam.marginalCovariance(X(k)))
            seconds[k] = perf_counter() - start
        ids = solver.landmark_ids
        landmark_covs = np.array([solver.isam.marginalCovariance(L(name)) for name in ids.tolist()])
    estimate = Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=without_negative_eigenvalues(pose_covs),
        landmark_ids=ids,
        landmarks=read_values(solver.isam.calculateEstimate())[1],
        landmark_covs=without_negative_eigenvalues(landmark_covs.reshape(-1, 2, 2)),
        association=solver.association,
        seconds=seconds,
    )
    return with_association(estimate, association)


class Isam2Solver:
    """GTSAM's iSAM2, run step by step on a recording.

    Args:
        recording: known association.
        parameters: GTSAM's settings.
        regularising: as for `GraphBuilder`.

    Attributes:
        isam: GTSAM's solver, for marginals and estimates.
    """

    def __init__(
        self, recording: Problem, parameters: gtsam.ISAM2Params, regularising: float = REGULARISING_NOISE
    ) -> None:
        self.isam = gtsam.ISAM2(parameters)
        self._recording = recording
        self._graph = IncrementalGraph(recording, regularising)
        self._path = np.zeros((recording.steps + 1, 3))  # newest estimates

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks in the graph, increasing."""
        return np.array(sorted(self._graph.mapped), dtype=np.int64)

    @property
    def association(self) -> Int:
        """(M,) landmark id of each observation, -1 if it is not in the graph."""
        return np.where(self._graph.used, self._recording.landmark, -1)

    def add_step(self, k: int) -> Float:
        """Process step k; return its pose (3,)."""
        path, recording = self._path, self._recording
        path[k] = compose(path[k - 1], recording.odometry[k - 1]) if k else recording.prior_mean
        self.isam.update(*self._graph.add_step(k, path))
        if waiting := self._graph.waiting(k):
            for step in np.unique(recording.observation_step[np.concatenate([*waiting.values()])]).tolist():
                path[step] = self._pose(step)
            graph, values = self._graph.add_waiting(waiting, path)
            if graph.size():
                self.isam.update(graph, values)
        path[k] = self._pose(k)
        return path[k]

    def _pose(self, k: int) -> Float:
        return pose_array(self.isam.calculateEstimatePose2(X(k)))
