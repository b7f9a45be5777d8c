"""GTSAM's incremental fixed-lag smoother on a recording, step by step.

This smoother is iSAM2 with marginalisation of variables whose time stamp is older than the lag. The time stamps are
step numbers. Landmarks get the newest stamp at every step, so they are never marginalised.
"""

from __future__ import annotations

from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int, Marks
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.gtsam_conversions import covariance_in_world, pose_array
from slamgauge.graph_baseline.gtsam_incremental import IncrementalGraph
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording
from slamgauge.se2 import compose
from slamgauge.validation import require_lag

LAG = 20  # steps
RELINEARIZE_THRESHOLD = 1e-3  # m or rad, checked at every step
UPDATES = 2  # Gauss-Newton steps per scan; the first one uses the linearisation from before the scan


@relative_to_start
def fixed_lag(recording: Recording, association: Int | None = None, lag: int = LAG) -> Estimate:
    """Return the newest pose of GTSAM's fixed-lag smoother at every step, and the final map.

    Poses in the window are relinearised; a marginalised pose keeps its last linearisation point. A bearing-only
    landmark is added to the graph when its bearings in the window place it; its older bearings are lost. Directions of
    zero variance get regularising noise (`gtsam_batch`).

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.
        lag: length of the window in steps, at least 1.

    Raises:
        UserError: the association is unknown, the measurements leave a variable undetermined, or `lag` is invalid.
    """
    lag = min(require_lag(lag), max(recording.steps, 1))
    problem, steps = prepare(recording, association), recording.steps
    smoother = FixedLagSmoother(problem, lag)
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    with explained():
        for k in range(steps + 1):
            start = perf_counter()
            poses[k], pose_covs[k] = smoother.add_step(k)
            seconds[k] = perf_counter() - start
        ids, landmarks, landmark_covs = smoother.landmarks()
    estimate = Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=without_negative_eigenvalues(pose_covs),
        landmark_ids=ids,
        landmarks=landmarks,
        landmark_covs=without_negative_eigenvalues(landmark_covs),
        association=np.where(smoother.used, problem.landmark, -1),
        seconds=seconds,
    )
    return with_association(estimate, association)


class FixedLagSmoother:
    """GTSAM's fixed-lag smoother, run step by step on a recording.

    Args:
        recording: known association.
        lag: length of the window in steps.
    """

    def __init__(self, recording: Problem, lag: int) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
        parameters.relinearizeSkip = 1
        parameters.setFactorization("QR")  # Cholesky loses the digits of regularising noise
        self._smoother = gtsam.IncrementalFixedLagSmoother(float(lag), parameters)
        self._recording, self._lag = recording, lag
        self._graph = IncrementalGraph(recording, motion_factors(recording), observation_factors(recording))
        self._path = np.zeros((recording.steps + 1, 3))  # newest estimates

    @property
    def used(self) -> Marks:
        """(M,) True for observations that are or were in the graph."""
        return self._graph.used

    def add_step(self, k: int) -> tuple[Float, Float]:
        """Process step k; return its pose (3,) and covariance (3, 3), world frame, additive."""
        path, recording = self._path, self._recording
        path[k] = compose(path[k - 1], recording.odometry[k - 1]) if k else recording.prior_mean
        self._update(k, *self._graph.add_steps(k, k + 1, path), [X(k)])
        graph, values = self._graph.add_waiting(k, k + 1, self._pose, oldest=k - self._lag)
        if graph.size():
            self._update(k, graph, values, [])
        path[k] = pose = self._pose(k)
        return pose, covariance_in_world(pose[2], self._smoother.marginalCovariance(X(k)))

    def landmarks(self) -> tuple[Int, Float, Float]:
        """Return ids (L,), positions (L, 2) [m] and covariances (L, 2, 2) of the map."""
        names = sorted(self._graph.mapped)
        places = [self._smoother.calculateEstimatePoint2(L(name)) for name in names]
        covs = [self._smoother.marginalCovariance(L(name)) for name in names]
        ids = np.array(names, dtype=np.int64)
        return ids, np.array(places).reshape(-1, 2), np.array(covs).reshape(-1, 2, 2)

    def _update(self, k: int, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int]) -> None:
        stamps = gtsam.FixedLagSmootherKeyTimestampMap()
        for key in [*keys, *map(L, self._graph.mapped)]:
            stamps.insert((key, float(k)))
        self._smoother.update(graph, values, stamps)
        for _ in range(1, UPDATES):
            self._smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), stamps)

    def _pose(self, k: int) -> Float:
        return pose_array(self._smoother.calculateEstimatePose2(X(k)))
