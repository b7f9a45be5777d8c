"""Estimate of the memory that an optimum needs."""

from __future__ import annotations

import numpy as np

from slamgauge.graph_baseline.problem.linearisation import linearise
from slamgauge.graph_baseline.problem.preparation import Problem, landmarks_at_median
from slamgauge.graph_baseline.solver.chain_partition import Plan, plan
from slamgauge.graph_baseline.solver.motion_elimination import eliminate_motions
from slamgauge.graph_baseline.solver.multifrontal import largest, numbers_kept
from slamgauge.memory import free_memory, require_memory
from slamgauge.sensors import SENSORS

# Largest number of arrays in memory at the same time.
MAPS, KEPT_MAPS = 10.0, 2.0  # maps of one piece's poses, and of all poses
MATRICES = 6.0  # information of one front, or of all landmarks
SPARSE = (
    "batch",
    "robust-batch",
    "gtsam-batch",
    "isam2",
)  # estimators that eliminate landmarks and poses in the order of least memory
KEYS, ROWS = 150.0, 20.0  # numbers per pose with a scan, and per measured value


def require_memory_for(recording: Problem, name: str) -> None:
    """Require enough free memory for the graph of a recording.

    Only the estimators in `SPARSE`, of landmarks that one observation places, do without the dense information (2L, 2L)
    of all landmarks. Of bearing-only recordings `batch` may need the causal optimum.

    Args:
        recording: known association.
        name: name of the estimator.

    Raises:
        UserError: there is not enough memory.
    """
    landmarks, scans = len(recording.landmark_ids), len(np.unique(recording.observation_step))
    needed = 8.0 * (MAPS * 3 * scans * 2 * landmarks + MATRICES * (2 * landmarks) ** 2)
    dense = name not in SPARSE or not SENSORS[recording.sensor].places_landmarks
    if not dense and needed > free_memory():
        path = recording.dead_reckoning
        model = linearise(recording, recording.slot, path, landmarks_at_median(recording, path))
        needed = bytes_of(plan(eliminate_motions(model), landmarks))
    require_memory(
        needed,
        f"{name} of {landmarks} landmarks in {scans} scans",
        "exclude this estimator or give a part of the recording",
    )


def bytes_of(planned: Plan) -> float:
    """Return the number of bytes for the solution of a linear problem with all covariances."""
    maps = [3.0 * len(piece.chain.key) * (len(piece.columns) + 1) for piece in planned.pieces]
    working = MAPS * max(maps) + MATRICES * largest(planned.front) ** 2
    small = sum(KEYS * len(piece.chain.key) + ROWS * piece.chain.model.r.size for piece in planned.pieces)
    return 8.0 * (working + KEPT_MAPS * sum(maps) + numbers_kept(planned.front) + small)
