"""GTSAM's own iSAM2 fed step by step: an independent witness of the causal optimum, for landmarks with ranges."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float
from slamgauge.graph_baseline.gtsam_graph import LENT_SLIP, GraphBuilder
from slamgauge.graph_baseline.problem.preparation import as_range_bearing
from slamgauge.recording import Recording


def gtsam_isam2(recording: Recording, relinearize_threshold: float = 0.05, relinearize_every: int = 10) -> Float:
    """The newest pose (N+1, 3) at every step; thresholds in m or rad.

    A motion of zero variance is lent a slip (`factors.LENT_SLIP`), and a position enters as range and bearing.
    """
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    parameters.setRelinearizeThreshold(relinearize_threshold)
    parameters.relinearizeSkip = relinearize_every
    solver, builder, known = gtsam.ISAM2(parameters), GraphBuilder(recording, LENT_SLIP), set[int]()
    polar = as_range_bearing(recording)[0]
    guess, path = gtsam.Pose2(*recording.prior_mean), np.empty((recording.steps + 1, 3))
    for k in range(recording.steps + 1):
        graph, values, order = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.KeyGroupMap()
        builder.add_motion(graph, k)
        if k > 0:
            guess = guess.compose(builder.increment(k))
            order.insert2(X(k - 1), 1)
        order.insert2(X(k), 2)  # eliminated last
        values.insert(X(k), guess)
        for name, row in builder.sights(k):
            if name not in known:
                values.insert(L(name), guess.transformFrom(point_at(*polar[row])))
                known.add(name)
            order.insert2(L(name), 1)
            graph.add(builder.sight_factor(k, row))
        solver.update(graph, values, [], order if order.size() > 2 else None)  # GTSAM needs more variables than groups
        guess = solver.calculateEstimatePose2(X(k))
        path[k] = guess.x(), guess.y(), guess.theta()
    return path


def point_at(distance: float, bearing: float) -> Float:
    """(2,) in the body frame."""
    return np.array([distance * np.cos(bearing), distance * np.sin(bearing)])
