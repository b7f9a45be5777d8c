"""Starting points of the exact solver from GTSAM's Levenberg-Marquardt, and inliers from graduated non-convexity.

Both run on the graph with regularising noise. From there `levenberg_marquardt` converges to the minimum of the exact
cost.
"""

from __future__ import annotations

import gtsam
import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.gtsam_conversions import make_values, read_values
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.problem.undetermined import explained


def build_graph(recording: Problem) -> gtsam.NonlinearFactorGraph:
    """Return the graph of the whole recording, in the order of steps: motion, then observations."""
    factors = [*motion_factors(recording), *observation_factors(recording)]
    steps = np.concatenate([np.arange(recording.steps + 1), recording.observation_step])
    graph = gtsam.NonlinearFactorGraph()
    for index in np.argsort(steps, kind="stable").tolist():
        graph.add(factors[index])
    return graph


def levenberg_marquardt(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int = 40) -> gtsam.Values:
    """Return the result of GTSAM's Levenberg-Marquardt from `values`, with a relative tolerance of 1e-5."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-5)
    parameters.setMaxIterations(iterations)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()


def descend(recording: Problem, poses: Float, landmarks: Float, iterations: int = 40) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2), ids increasing, after GTSAM's Levenberg-Marquardt."""
    values = make_values(poses, recording.landmark_ids, landmarks)
    with explained():
        return read_values(levenberg_marquardt(build_graph(recording), values, iterations))


def find_inliers(recording: Problem, poses: Float, landmarks: Float, probability: float) -> Marks:
    """Return a mask (M,) of the inliers of graduated non-convexity from poses (N+1, 3) and landmarks (L, 2).

    The cost of an observation is truncated. The cost of a correct observation is below this limit with `probability`.
    """
    graph = build_graph(recording)
    rows = recording.observation_step + 1 + np.arange(len(recording.observation))  # factors follow those of motions
    parameters = gtsam.GncLMParams()
    parameters.setLossType(gtsam.GncLossType.TLS)
    parameters.setKnownInliers(np.setdiff1d(np.arange(graph.size()), rows).tolist())
    with explained():
        values = make_values(poses, recording.landmark_ids, landmarks)
        optimizer = gtsam.GncLMOptimizer(graph, values, parameters)
        optimizer.setInlierCostThresholdsAtProbability(probability)
        optimizer.optimize()
    return np.asarray(optimizer.getWeights())[rows] >= 0.5
