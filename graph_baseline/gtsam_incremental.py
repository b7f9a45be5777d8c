"""GTSAM's incremental solvers on a recording: factors of each step, the newest pose at every step, iSAM2's path."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_conversions import covariance_in_world, pose_array
from slamgauge.graph_baseline.problem.placement import triangulate_one
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.se2 import chain, compose
from slamgauge.sensors import SENSORS

HEADING_DRIFT = 0.1  # rad; with 0.4 rad, `gtsam_batch` ends in another minimum in 3 of 10 runs of ukfm-slam2d

Factors = list[gtsam.NonlinearFactor]
Solver = gtsam.ISAM2 | gtsam.IncrementalFixedLagSmoother
Update = Callable[[int, gtsam.NonlinearFactorGraph, gtsam.Values], None]  # step, its factors, initial values


class IncrementalGraph:
    """Factors and initial values that the next steps add, for GTSAM's incremental solvers.

    A landmark is added with its first observation. A bearing-only landmark is added later, with all its bearings, as
    soon as they place it (`triangulation`).

    Args:
        problem: recording with known association.
        motions: N+1 factors, of the prior and of each odometry increment.
        observations: M factors.

    Attributes:
        problem: as given.
        mapped: ids of the landmarks in the graph.
        used: (M,) True for observations in the graph.
    """

    def __init__(self, problem: Problem, motions: Factors, observations: Factors) -> None:
        self.problem, self._motions, self._observations = problem, motions, observations
        self._landmark = problem.landmark.tolist()
        self._bounds = np.searchsorted(problem.observation_step, np.arange(problem.steps + 2)).tolist()
        self._waiting: dict[int, list[int]] = {}  # rows by id, for landmarks that their bearings do not place yet
        self._path = np.zeros((problem.steps + 1, 3))  # poses from which waiting landmarks were observed
        self.mapped: set[int] = set()
        self.used = np.zeros(len(observations), dtype=np.bool_)

    def add_steps(self, first: int, end: int, path: Float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Return the factors of steps `first` to `end` - 1, and initial values of new variables, given a path (N+1, 3).

        The path must contain these steps.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        places_landmarks = SENSORS[self.problem.sensor].places_landmarks
        for k in range(first, end):
            graph.add(self._motions[k])
            values.insert(X(k), gtsam.Pose2(*path[k]))
        for row in range(self._bounds[first], self._bounds[end]):
            name = self._landmark[row]
            if name not in self.mapped and places_landmarks:
                self._add_landmark(name, self.problem.positions_seen(np.array([row]), path)[0], values)
            if name in self.mapped:
                self._add_observation(row, graph)
            else:
                self._waiting.setdefault(name, []).append(row)
        return graph, values

    def add_waiting(
        self, first: int, end: int, pose: Callable[[int], Float]
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Return factors and initial values of waiting landmarks that their bearings place.

        Only landmarks observed at steps `first` to `end` - 1 are tried. `pose` returns the newest pose (3,) of a step.
        """
        graph, values, steps = gtsam.NonlinearFactorGraph(), gtsam.Values(), self.problem.observation_step
        names = {*self._landmark[self._bounds[first] : self._bounds[end]]} if self._waiting else set[int]()
        for name in sorted(names & self._waiting.keys()):
            rows = self._waiting[name]
            for step in np.unique(steps[rows]).tolist():
                self._path[step] = pose(step)
            landmark, sigma = triangulate_one(self.problem, np.array(rows), self._path)
            if np.isfinite(sigma):
                self._add_landmark(name, landmark, values)
                for row in self._waiting.pop(name):
                    self._add_observation(row, graph)
        return graph, values

    def _add_landmark(self, name: int, landmark: Float, values: gtsam.Values) -> None:
        self.mapped.add(name)
        values.insert(L(name), gtsam.Point2(*landmark))

    def _add_observation(self, row: int, graph: gtsam.NonlinearFactorGraph) -> None:
        graph.add(self._observations[row])
        self.used[row] = True


def newest_poses(graph: IncrementalGraph, solver: Solver, update: Update) -> Estimate:
    """Return the newest pose of an incremental solver at every step, and its final map.

    Args:
        graph: of the recording, without steps.
        solver: without factors.
        update: adds factors to the solver.

    Raises:
        UserError: the measurements leave a variable undetermined.
    """
    problem, steps = graph.problem, graph.problem.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)

    def pose(step: int) -> Float:
        return pose_array(solver.calculateEstimatePose2(X(step)))

    with explained():
        for k in range(steps + 1):
            start = perf_counter()
            poses[k] = compose(poses[k - 1], problem.odometry[k - 1]) if k else problem.prior_mean
            update(k, *graph.add_steps(k, k + 1, poses))
            placed, values = graph.add_waiting(k, k + 1, pose)
            if placed.size():
                update(k, placed, values)
            poses[k] = pose(k)
            pose_covs[k] = covariance_in_world(poses[k, 2], solver.marginalCovariance(X(k)))
            seconds[k] = perf_counter() - start
        names = sorted(graph.mapped)
        landmarks = [solver.calculateEstimatePoint2(L(name)) for name in names]
        landmark_covs = [solver.marginalCovariance(L(name)) for name in names]
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=without_negative_eigenvalues(pose_covs),
        landmark_ids=np.array(names, dtype=np.int64),
        landmarks=np.array(landmarks).reshape(-1, 2),
        landmark_covs=without_negative_eigenvalues(np.array(landmark_covs).reshape(-1, 2, 2)),
        association=np.where(graph.used, problem.landmark, -1),
        seconds=seconds,
    )


def isam2_path(problem: Problem, motions: Factors, observations: Factors) -> Float:
    """Return iSAM2's path (N+1, 3), an initial value for optimisers; arguments as for `IncrementalGraph`.

    Each update adds the steps during which the heading of dead reckoning may drift by HEADING_DRIFT (one standard
    deviation). An update at every step takes 3 s on q1-long-dense instead of 0.2 s.
    """
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1  # check for relinearisation at every update
    isam, graph = gtsam.ISAM2(parameters), IncrementalGraph(problem, motions, observations)
    path = problem.dead_reckoning.copy()
    drift = np.append(0.0, np.cumsum(problem.odometry_cov[:, 2, 2]))  # variance of the heading
    for steps in np.split(np.arange(problem.steps + 1), np.flatnonzero(np.diff(drift // HEADING_DRIFT**2)) + 1):
        first, end = int(steps[0]), int(steps[-1]) + 1
        if first > 0:
            path[first - 1 : end] = chain(path[first - 1], problem.odometry[first - 1 : end - 1])
        isam.update(*graph.add_steps(first, end, path))
        path[:end] = gtsam.utilities.extractPose2(isam.calculateEstimate())
        placed, values = graph.add_waiting(first, end, path.__getitem__)
        if placed.size():
            isam.update(placed, values)
            path[:end] = gtsam.utilities.extractPose2(isam.calculateEstimate())
    return path
