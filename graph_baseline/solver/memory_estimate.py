"""Estimate of the memory that an optimum needs."""

from __future__ import annotations

from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.solver.levenberg_marquardt import planned_at
from slamgauge.graph_baseline.solver.multifrontal import largest, numbers_kept
from slamgauge.graph_baseline.solver.partition import Plan
from slamgauge.memory import free_memory, require_memory
from slamgauge.sensors import SENSORS

# Largest number of arrays in memory at the same time.
MAPS, KEPT_MAPS = 6.0, 3.0  # maps of one piece's poses, and of all poses
MATRICES = 6.0  # information of one front, or of all landmarks
SPARSE = ("batch", "robust-batch", "gtsam-batch", "isam2")  # eliminate variables in the order of least memory
NUMBERS, ROWS = 150.0, 40.0  # per pose, and per measured value


def require_memory_for(problem: Problem, name: str) -> None:
    """Require enough free memory for the graph of a recording.

    Only the estimators in `SPARSE`, of landmarks that one observation places, do without the dense information (2L, 2L)
    of all landmarks. Of bearing-only recordings `batch` may need the causal optimum.

    Args:
        problem: recording.
        name: name of the estimator.

    Raises:
        UserError: there is not enough memory.
    """
    landmarks, poses = len(problem.landmark_ids), problem.steps + 1
    needed = 8.0 * (MAPS * 3 * poses * 2 * landmarks + MATRICES * (2 * landmarks) ** 2)
    dense = name not in SPARSE or not SENSORS[problem.sensor].places_landmarks
    if not dense and needed > free_memory():
        objective, path = Objective(problem), problem.dead_reckoning
        needed = bytes_of(planned_at(objective, objective.at(path, landmarks_at_median(problem, path))))
    require_memory(
        needed,
        f"{name} of {landmarks} landmarks in {poses} poses",
        "exclude this estimator or give a part of the recording",
    )


def bytes_of(planned: Plan) -> float:
    """Return the number of bytes for the solution of a linear problem with all covariances."""
    poses = [each.poses.stop - each.poses.start for each in planned.pieces]
    maps = [3.0 * count * (len(each.columns) + 1) for count, each in zip(poses, planned.pieces, strict=True)]
    rows = planned.pieces[-1].rows.stop
    kept = KEPT_MAPS * sum(maps) + numbers_kept(planned.front) + NUMBERS * sum(poses) + ROWS * rows
    return 8.0 * (MAPS * max(maps) + MATRICES * largest(planned.front) ** 2 + kept)
