"""The causal optimum: at every step the newest pose of the optimum of all measurements up to it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.hindsight import batch, bearing_only_optimum, optimum_from, optimum_near
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.incremental import SHORT, IncrementalOptimum
from slamgauge.graph_baseline.solver.memory_estimate import require_memory_for
from slamgauge.graph_baseline.solver.search import degrees_of_freedom, explained_by_noise
from slamgauge.graph_baseline.solver.smoother import EXACT
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS


@relative_to_start
def causal(recording: Recording, association: Int | None = None) -> Estimate:
    """Return at each step the newest pose of the exact optimum of the measurements up to this step (`incremental`).

    Like iSAM2 (Kaess et al., IJRR 31(2), 2012), `causal` is an incremental smoother that relinearises, but it converges
    to the minimum of the exact cost. `Estimate.optimum_check` compares the last pose with the optimum of the whole
    recording: the minimum that `batch` finds from the final path and map, or a lower one if noise does not explain the
    cost of that minimum.

    A bearing-only landmark enters when its bearings place it. A landmark that they never place is not in the map, and
    its `association` is -1.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording, for instance an `Estimate.association`; -1 excludes
            an observation.

    Raises:
        UserError: the association is unknown, or the measurements leave a variable undetermined.
    """
    problem = prepare(recording, association)
    require_memory_for(problem, "causal")
    incremental = IncrementalOptimum(problem)
    steps = problem.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    map_changes: list[_PathAndMap] = []
    for k in range(steps + 1):
        start = perf_counter()
        incremental.add_step()
        poses[k], pose_covs[k] = incremental.newest_pose(), incremental.newest_cov()
        seconds[k] = perf_counter() - start
        if not SENSORS[problem.sensor].places_landmarks and steps <= SHORT:
            map_changes.append(_path_and_map(incremental))
    incremental.finish()
    estimate = Estimate(
        kind="filtered", poses=poses, pose_covs=without_negative_eigenvalues(pose_covs), seconds=seconds
    )
    return with_association(_with_map(problem, estimate, incremental, map_changes), association)


class _PathAndMap(NamedTuple):
    """Result after a step: path (k+1, 3), ids of active landmarks (L,), and number of minimum switches so far."""

    path: Float
    landmark_ids: Int
    switches: int


def _path_and_map(incremental: IncrementalOptimum) -> _PathAndMap:
    return _PathAndMap(incremental.path_and_map()[0], incremental.landmark_ids, len(incremental.switches))


def _with_map(
    recording: Problem, estimate: Estimate, incremental: IncrementalOptimum, map_changes: list[_PathAndMap]
) -> Estimate:
    """Add the map of the last step and the comparison with `batch`; without a minimum, add the map of `batch`."""
    if not incremental.converged:
        last = batch(recording)
        return replace(
            last,
            kind="filtered",
            poses=estimate.poses,
            pose_covs=estimate.pose_covs,
            seconds=estimate.seconds,
            optimum_check=np.inf,
        )
    path, landmarks = incremental.path_and_map()
    ids = recording.landmark
    association = np.where(np.isin(ids, incremental.landmark_ids), ids, -1)
    used = prepare(recording, association)
    chi_square, freedom = 2.0 * Objective(used).at(path, landmarks).cost, degrees_of_freedom(used)
    farthest = np.inf
    if not incremental.unconverged_steps:
        farthest = _last_distance(recording, estimate, path, landmarks)
        if recording.steps <= SHORT or explained_by_noise(chi_square, freedom):
            farthest = max(farthest, _largest_earlier_distance(recording, estimate, incremental, map_changes))
    return replace(
        estimate,
        landmark_ids=incremental.landmark_ids,
        landmarks=incremental.landmarks(),
        landmark_covs=incremental.landmark_covs(),
        association=association,
        chi_square=chi_square,
        chi_square_dof=freedom,
        optimum_check=farthest,
    )


def _last_distance(recording: Problem, estimate: Estimate, path: Float, landmarks: Float) -> float:
    """Return the distance (see `_distance`) of the last pose from the optimum, infinite if that does not exist."""
    if not SENSORS[recording.sensor].places_landmarks:
        return _distance_if_any(estimate, lambda: optimum_from(recording, path))
    return _distance_if_any(estimate, lambda: optimum_near(recording, path, landmarks))


def _largest_earlier_distance(
    recording: Problem, estimate: Estimate, incremental: IncrementalOptimum, map_changes: list[_PathAndMap]
) -> float:
    """Return the largest distance (see `_distance`) of some poses from the optimum of the same measurements.

    The poses are those before a switch to another minimum, and in short bearing-only recordings those before a change
    of the map. If noise does not explain the cost of a long recording, minima switch often, and these are not checked.
    The distance is infinite if the optimum does not exist. Before a change of the map such a pose is ignored, because
    an optimum need not exist just before a landmark is placed.
    """
    farthest = 0.0
    for path_after, landmark_ids in incremental.switches:
        if len(landmark_ids):
            part = recording.first(len(path_after) - 2)
            part = part.only(np.isin(part.landmark, landmark_ids))
            before = functools.partial(optimum_from, part, path_after[:-1])
            farthest = max(farthest, _distance_if_any(estimate, before))
    for before, after in pairwise(map_changes):
        if after.switches > before.switches or not np.array_equal(after.landmark_ids, before.landmark_ids):
            part = recording.first(len(before.path) - 1)
            with suppress(UndeterminedError):
                farthest = max(farthest, _distance(optimum_from(part, after.path[:-1]), estimate))
            with suppress(UndeterminedError):
                optimum = bearing_only_optimum(part, lambda before=before: before.path)
                farthest = max(farthest, _distance(optimum, estimate))
    return farthest


def _distance_if_any(estimate: Estimate, optimum: Callable[[], Estimate]) -> float:
    """Return `_distance` from an optimum, infinite if it does not exist."""
    try:
        return _distance(optimum(), estimate)
    except UndeterminedError:
        return np.inf


def _distance(optimum: Estimate, estimate: Estimate) -> float:
    """Return the largest difference of pose or sigma at the last pose of an optimum, in sigmas of the optimum."""
    last = len(optimum.poses) - 1
    assert optimum.pose_covs is not None and estimate.pose_covs is not None
    expected, sigma = (np.sqrt(np.diag(covs[last])) for covs in (optimum.pose_covs, estimate.pose_covs))
    difference = estimate.poses[last] - optimum.poses[last]
    difference[2] = wrap(difference[2])
    free = expected > EXACT
    distances = [np.abs(difference[free]) / expected[free], np.abs(sigma[free] / expected[free] - 1.0)]
    return float(np.concatenate(distances).max(initial=0.0))
