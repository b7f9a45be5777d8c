"""The causal optimum: at every step the newest pose of the optimum of all measurements up to it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from time import perf_counter

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.correlations import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.demand import require_room, tell_if_long
from slamgauge.graph_baseline.factors import among_mapped, relative_to_start, require_known_landmarks
from slamgauge.graph_baseline.growing import SHORT, GrowingOptimum, Leap
from slamgauge.graph_baseline.hindsight import batch, optimum_from, optimum_near, optimum_of_bearings
from slamgauge.graph_baseline.search import chi_square_of
from slamgauge.graph_baseline.undetermined import UndeterminedError
from slamgauge.recording import Recording
from slamgauge.se2 import wrap


@relative_to_start
def isam2(recording: Recording, association: Int | None = None) -> Estimate:
    """What the measurements up to each step allow: the newest pose of an optimum that grows with them (`growing`).

    It does what iSAM2 (Kaess et al., IJRR 31(2), 2012) does, incremental smoothing with relinearisation, but goes to
    the minimum of the exact cost; tests hold it against GTSAM's iSAM2 and against `batch` on the first steps. Its last
    pose is always checked against `batch` on the whole recording (`Estimate.optimum_check`).

    With bearings alone a landmark waits, with its bearings, until they place it (`triangulation`); one that they never
    place is no part of the map, and its `association` is -1.

    Args:
        recording: what was measured.
        association: (M,) ids in place of the recording's own, an `Estimate.association` for instance; -1 leaves
            an observation out.

    Raises:
        UserError: the recording cannot be turned into a graph, or leaves a variable undetermined.
    """
    if association is not None:
        return among_mapped(isam2(recording.associated(association)), association)
    require_room(recording, "isam2")
    tell_if_long(recording)
    growing = GrowingOptimum(recording)
    steps = recording.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    for k in range(steps + 1):
        start = perf_counter()
        growing.add_step()
        poses[k], pose_covs[k] = growing.newest_pose(), growing.newest_cov()
        seconds[k] = perf_counter() - start
    growing.finish()
    estimate = Estimate(
        kind="filtered", poses=poses, pose_covs=without_negative_eigenvalues(pose_covs), seconds=seconds
    )
    return _with_map(recording, estimate, growing)


def _with_map(recording: Recording, estimate: Estimate, growing: GrowingOptimum) -> Estimate:
    """The estimate with the map of the last step, and how it compares with `batch`; with batch's map if it has none."""
    if not growing.settled:
        last = batch(recording)
        return replace(
            last,
            kind="filtered",
            poses=estimate.poses,
            pose_covs=estimate.pose_covs,
            seconds=estimate.seconds,
            optimum_check=np.inf,
        )
    path, landmarks = growing.path_and_map()
    ids = require_known_landmarks(recording)
    association = np.where(np.isin(ids, growing.landmark_ids), ids, -1)
    chi_square, freedom = chi_square_of(recording.associated(association), path, landmarks)
    return replace(
        estimate,
        landmark_ids=growing.landmark_ids,
        landmarks=growing.landmarks(),
        landmark_covs=growing.landmark_covs(),
        association=association,
        chi_square=chi_square,
        chi_square_dof=freedom,
        optimum_check=np.inf
        if growing.unsettled_steps
        else _farthest_off(recording, path, landmarks, estimate, growing.leaps),
    )


def _farthest_off(recording: Recording, path: Float, landmarks: Float, estimate: Estimate, leaps: list[Leap]) -> float:
    """How far off (see `_off`) the last pose is, and each before a leap: its step might have known better."""
    try:
        farthest = _off(optimum_near(recording, path, landmarks), estimate)
    except UndeterminedError:
        return np.inf
    ids = require_known_landmarks(recording)
    for before, after, landmark_ids in leaps:
        part = recording.first(len(before) - 1) if len(before) else None
        if part is None or (recording.steps > SHORT and not len(landmark_ids)):
            continue
        if recording.steps > SHORT:  # a landmark more or less for a step is not worth a doubt
            rows = ids[: len(part.observation)]
            part = part.associated(np.where(np.isin(rows, landmark_ids), rows, -1))
        with suppress(UndeterminedError):
            farthest = max(farthest, _off(optimum_from(part, after[:-1]), estimate))
        if recording.sensor == "bearing" and recording.steps <= SHORT:
            with suppress(UndeterminedError):
                farthest = max(farthest, _off(optimum_of_bearings(part, lambda before=before: before), estimate))
    return farthest


def _off(optimum: Estimate, estimate: Estimate) -> float:
    """How far an optimum's last pose and its sigmas are from those of an estimate, in sigmas of the optimum."""
    last = len(optimum.poses) - 1
    assert optimum.pose_covs is not None and estimate.pose_covs is not None
    sigma, own = (np.sqrt(np.diag(covs[last])) for covs in (optimum.pose_covs, estimate.pose_covs))
    apart = estimate.poses[last] - optimum.poses[last]
    apart[2] = wrap(apart[2])
    known = sigma > 1e-9  # m or rad
    off = np.concatenate([np.abs(apart[known]) / sigma[known], np.abs(own[known] / sigma[known] - 1.0)])
    return float(off.max(initial=0.0))
