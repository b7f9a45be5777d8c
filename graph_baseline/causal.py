"""The causal optimum: at every step the newest pose of the optimum of all measurements up to it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from time import perf_counter

import numpy as np

from slamgauge.arrays import Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.hindsight import batch, optimum_from
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.incremental import SHORT, IncrementalOptimum
from slamgauge.graph_baseline.solver.search import degrees_of_freedom, explained_by_noise
from slamgauge.graph_baseline.solver.smoother import EXACT, require_memory_for
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
    for k in range(steps + 1):
        start = perf_counter()
        incremental.add_step()
        poses[k], pose_covs[k] = incremental.newest_pose(), incremental.newest_cov()
        seconds[k] = perf_counter() - start
    incremental.finish()
    estimate = Estimate(
        kind="filtered", poses=poses, pose_covs=without_negative_eigenvalues(pose_covs), seconds=seconds
    )
    return with_association(_with_map(problem, estimate, incremental), association)


def _with_map(problem: Problem, estimate: Estimate, incremental: IncrementalOptimum) -> Estimate:
    """Add the map of the last step and the comparison with `batch`; without a minimum, add the map of `batch`."""
    if not incremental.converged:
        filtered = {name: getattr(estimate, name) for name in ("kind", "poses", "pose_covs", "seconds")}
        return replace(batch(problem), **filtered, optimum_check=np.inf)
    path, landmarks = incremental.path_and_map()
    association = np.where(np.isin(problem.landmark, incremental.landmark_ids), problem.landmark, -1)
    used = prepare(problem, association)
    chi_square, freedom = 2.0 * Objective(used).at(path, landmarks).cost, degrees_of_freedom(used)
    farthest, places_landmarks = np.inf, SENSORS[problem.sensor].places_landmarks
    if not incremental.unconverged_steps:
        with suppress(UndeterminedError):
            farthest = _distance(optimum_from(problem, path, landmarks if places_landmarks else None), estimate)
        if problem.steps <= SHORT or explained_by_noise(chi_square, freedom):
            farthest = max([farthest, *_earlier_distances(problem, estimate, incremental)])
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


def _earlier_distances(problem: Problem, estimate: Estimate, incremental: IncrementalOptimum) -> Iterator[float]:
    """Yield the distances of the poses before a change of minimum or map from the optimum of the same measurements.

    If noise does not explain the cost of a long recording, minima change often, and these are not checked. A pose
    without an optimum is ignored: an optimum need not exist just before a landmark is placed.
    """
    for path, landmark_ids in incremental.changes:
        part = problem.first(len(path) - 2)
        if problem.steps > SHORT and not SENSORS[problem.sensor].places_landmarks:
            part = part.only(np.isin(part.landmark, landmark_ids))
        with suppress(UndeterminedError):
            yield _distance(optimum_from(part, path[:-1]), estimate)


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
