"""GTSAM's incremental fixed-lag smoother on a recording, step by step.

It is iSAM2 that marginalises what is older than the lag, by time stamps: here the numbers of steps. Landmarks get the
newest stamp at every step, and stay. Bearings of a landmark wait until those of the window place it (`triangulation`).
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int
from slamgauge.back_projection import positions_seen
from slamgauge.graph_baseline.gtsam_graph import LENT_SLIP, GraphBuilder
from slamgauge.graph_baseline.problem.placement import triangulate_one
from slamgauge.graph_baseline.problem.preparation import require_known_landmarks
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation
from slamgauge.sensors import SENSORS

RELINEARISED = 1e-3  # m or rad: what has moved farther is linearised anew, at every step
PASSES = 2  # Gauss-Newton steps for each that the robot takes; after one, matrices are those from before its scan


class LaggingOptimum:
    """The optimum of the last steps of a recording, given what the steps before have left.

    Args:
        recording: known association.
        lag: steps.

    Attributes:
        taken: (M,) whether an observation is part of the graph, or was.
    """

    def __init__(self, recording: Recording, lag: int) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARISED)
        parameters.relinearizeSkip = 1
        parameters.setFactorization("QR")  # of a slip that is small beside the other noise
        self._smoother = gtsam.IncrementalFixedLagSmoother(float(lag), parameters)
        self._recording, self._lag = recording, lag
        self._builder = GraphBuilder(recording, LENT_SLIP)
        self._ids = require_known_landmarks(recording)
        self._poses = np.zeros((recording.steps + 1, 3))  # newest estimates
        self._mapped: set[int] = set()
        self._waiting: dict[int, list[int]] = {}  # rows of landmarks that are not mapped
        self.taken = np.zeros(len(self._ids), dtype=np.bool_)

    def add_step(self, k: int) -> tuple[Float, Float]:
        """Take in step k; its pose (3,) and covariance (3, 3), world frame, additive."""
        recording, graph, values = self._recording, gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._builder.add_motion(graph, k)
        guess = compose(self._poses[k - 1], recording.odometry[k - 1]) if k else recording.prior_mean
        self._poses[k] = guess
        values.insert(X(k), gtsam.Pose2(*guess))
        for name, row in self._builder.sights(k):
            if name not in self._mapped and SENSORS[recording.sensor].places_landmarks:
                self._map(name, positions_seen(recording, np.array([row]), self._poses)[0], values)
            if name in self._mapped:
                self._see(k, row, graph)
            else:
                self._waiting.setdefault(name, []).append(row)
        self._update(k, graph, values, [X(k)])
        seen = {name for name, _ in self._builder.sights(k)}
        self._place_waiting(k, sorted(seen & self._waiting.keys()))
        self._poses[k] = pose = self._pose(k)
        turn = np.eye(3)
        turn[:2, :2] = rotation(pose[2])
        return pose, turn @ self._smoother.marginalCovariance(X(k)) @ turn.T

    def landmarks(self) -> tuple[Int, Float, Float]:
        """Ids (L,), positions (L, 2) [m] and covariances (L, 2, 2) of the map."""
        names = sorted(self._mapped)
        places = [self._smoother.calculateEstimatePoint2(L(name)) for name in names]
        covs = [self._smoother.marginalCovariance(L(name)) for name in names]
        ids = np.array(names, dtype=np.int64)
        return ids, np.array(places).reshape(-1, 2), np.array(covs).reshape(-1, 2, 2)

    def _place_waiting(self, k: int, names: list[int]) -> None:
        """Take in landmarks that the bearings of the window place."""
        graph, values, steps = gtsam.NonlinearFactorGraph(), gtsam.Values(), self._recording.observation_step
        for name in names:
            rows = self._waiting[name] = [row for row in self._waiting[name] if steps[row] >= k - self._lag]
            for step in {*steps[rows].tolist()}:
                self._poses[step] = self._pose(step)
            landmark, sigma = triangulate_one(self._recording, np.array(rows), self._poses)
            if np.isfinite(sigma):
                self._map(name, landmark, values)
                for row in self._waiting.pop(name):
                    self._see(int(steps[row]), row, graph)
        if graph.size():
            self._update(k, graph, values, [])

    def _map(self, name: int, landmark: Float, values: gtsam.Values) -> None:
        self._mapped.add(name)
        values.insert(L(name), gtsam.Point2(*landmark))

    def _see(self, k: int, row: int, graph: gtsam.NonlinearFactorGraph) -> None:
        graph.add(self._builder.sight_factor(k, row))
        self.taken[row] = True

    def _update(self, k: int, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int]) -> None:
        stamps = gtsam.FixedLagSmootherKeyTimestampMap()
        for key in [*keys, *map(L, self._mapped)]:
            stamps.insert((key, float(k)))
        self._smoother.update(graph, values, stamps)
        for _ in range(1, PASSES):
            self._smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), stamps)

    def _pose(self, k: int) -> Float:
        found = self._smoother.calculateEstimatePose2(X(k))
        return np.array([found.x(), found.y(), found.theta()])
