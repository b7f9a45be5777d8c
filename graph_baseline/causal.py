"""The causal optimum: iSAM2 fed step by step, its newest pose and marginal at every step."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from slamgauge.arrays import Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.factors import among_mapped, read_values, require_known_landmarks
from slamgauge.graph_baseline.incremental import SETTINGS, GrowingProblem, Settings
from slamgauge.graph_baseline.smoother import solve_at
from slamgauge.graph_baseline.undetermined import explained
from slamgauge.recording import Recording


def isam2(recording: Recording, association: Int | None = None) -> Estimate:
    """What the measurements up to each step allow: the newest pose of an incremental optimum (iSAM2).

    With bearings alone a landmark waits, with its bearings, until they place it (`triangulation`); one that they never
    place is no part of the map, and its `association` is -1.

    The `position` sensor enters as range and bearing with its covariance carried over, and a motion
    direction of zero variance is lent a slip (`factors.LENT_SLIP`): with hard constraints iSAM2 fails on
    maps of 300 landmarks, and the sigmas it would find there are the same to 1e-5.

    Args:
        recording: what was measured.
        association: (M,) ids in place of the recording's own, an `Estimate.association` for instance; -1 leaves
            an observation out.

    Raises:
        UserError: the recording cannot be turned into a graph, or leaves a variable undetermined.
    """
    if association is not None:
        return among_mapped(isam2(recording.associated(association)), association)
    return causal_optimum(recording, SETTINGS)


def causal_optimum(recording: Recording, settings: Settings) -> Estimate:
    """`isam2` with other settings.

    Cholesky is twice as fast as QR on large maps, but GTSAM's takes a long stretch without observations
    for an undetermined problem; QR then has the last word.
    """
    with explained():
        try:
            return _run(recording, GrowingProblem(recording, settings, "CHOLESKY"))
        except RuntimeError:
            return _run(recording, GrowingProblem(recording, settings, "QR"))


def _run(recording: Recording, growing: GrowingProblem) -> Estimate:
    steps = recording.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    for k in range(steps + 1):
        start = perf_counter()
        growing.add_step(k)
        growing.optimise()
        poses[k], pose_covs[k] = growing.newest_pose(), growing.newest_pose_cov()
        seconds[k] = perf_counter() - start
    smoothed, landmarks = read_values(growing.solver.calculateEstimate())
    landmark_ids = np.array(sorted(growing.known), dtype=np.int64)
    ids = require_known_landmarks(recording)
    association = np.where(np.isin(ids, landmark_ids), ids, -1)
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=pose_covs,
        landmark_ids=landmark_ids,
        landmarks=landmarks,
        # one by one, GTSAM's marginals take minutes on maps of 1000 landmarks
        landmark_covs=solve_at(recording.associated(association), landmark_ids, smoothed, landmarks).landmark_covs,
        association=association,
        seconds=seconds,
    )
