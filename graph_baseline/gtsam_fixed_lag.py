"""GTSAM's incremental fixed-lag smoother on a recording, step by step.

This smoother is iSAM2 with marginalisation of variables whose time stamp is older than the lag. The time stamps are
step numbers. Landmarks get the newest stamp at every step, so they are never marginalised.
"""

from __future__ import annotations

import gtsam
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Int
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.gtsam_batch import motion_factors, observation_factors
from slamgauge.graph_baseline.gtsam_incremental import IncrementalGraph, newest_poses
from slamgauge.graph_baseline.problem.preparation import prepare, relative_to_start, with_association
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.validation import as_whole

LAG = 20  # steps
RELINEARIZED_ABOVE = 1e-3  # m or rad, checked at every step
UPDATES = 2  # Gauss-Newton steps per scan; the first one uses the linearisation from before the scan


@relative_to_start
def fixed_lag(recording: Recording, association: Int | None = None, lag: int = LAG) -> Estimate:
    """Return the newest pose of GTSAM's fixed-lag smoother at every step, and the final map.

    Poses in the window are relinearised; a marginalised pose keeps its last linearisation point. Directions of zero
    variance get regularising noise (`gtsam_batch`).

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.
        lag: length of the window in steps, at least 1.

    Raises:
        UserError: the association is unknown, the measurements leave a variable undetermined, `lag` is invalid, or the
            recording is bearing-only: a window that places landmarks from few bearings is overconfident.
    """
    problem = prepare(recording, association)
    if not SENSORS[problem.sensor].places_landmarks:
        raise UserError("fixed_lag: a window of bearings is overconfident and diverges; use isam2 for this recording")
    lag = min(as_whole("lag", lag, "steps leave no window", 1), max(problem.steps, 1))
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(RELINEARIZED_ABOVE)
    parameters.relinearizeSkip = 1
    parameters.setFactorization("QR")  # Cholesky loses the digits of regularising noise
    smoother = gtsam.IncrementalFixedLagSmoother(float(lag), parameters)
    graph = IncrementalGraph(problem, motion_factors(problem), observation_factors(problem))

    def update(k: int, factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        stamps = gtsam.FixedLagSmootherKeyTimestampMap()
        for key in [X(k), *map(L, graph.mapped)]:
            stamps.insert((key, float(k)))
        smoother.update(factors, values, stamps)
        for _ in range(1, UPDATES):
            smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), stamps)

    return with_association(newest_poses(graph, smoother, update), association)
