"""The hindsight optimum: all poses and landmarks with their covariances, given all measurements.

1. GTSAM's Levenberg-Marquardt starts from a path, by default dead reckoning, with regularising noise on zero variances.
2. Damped steps (`levenberg_marquardt`) approach a minimum of the exact cost, in which zero variances are constraints.
3. If the stated noise explains the cost (chi-square test), the search ends, but with bearings of a short
   recording only after two starts have led to the lowest minimum. Otherwise other starts are tried: the minimum of a
   surrogate that needs no start (`isotropic_surrogate`), inflated observation noise, the path of the causal optimum, a
   start that adds the recording in portions, and dead reckoning.
4. Gauss-Newton steps converge to the lowest minimum.

A bearing-only landmark is added if its bearings place it from the optimum without it, and removed if the optimum with
it no longer places it. Unless all landmarks are placed, the search is repeated from the path of the causal optimum,
which places more landmarks than dead reckoning.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.problem.preparation import (
    Problem,
    landmarks_at_median,
    prepare,
    relative_to_start,
    with_association,
)
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.cost_estimate import require_memory_for
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum
from slamgauge.graph_baseline.solver.isotropic_surrogate import surrogate_start
from slamgauge.graph_baseline.solver.levenberg_marquardt import Minimum
from slamgauge.graph_baseline.solver.multistart import (
    Start,
    degrees_of_freedom,
    descent_start,
    growing_start,
    inflated_noise_start,
    lowest_minimum,
    placed_minimum,
)
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

MOST_SWITCHES = 10  # each is a search from several starts; without a limit 1 m of odometry noise a step costs minutes


@relative_to_start
def batch(recording: Recording, association: Int | None = None) -> Estimate:
    """Return the maximum a posteriori path and map given all measurements.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording, for instance an `Estimate.association`; -1 excludes
            an observation.

    Raises:
        UserError: the association is unknown, the measurements leave a variable undetermined, or no minimum was found.
    """
    problem = prepare(recording, association)
    require_memory_for(problem, "batch")
    if SENSORS[recording.sensor].places_landmarks:
        found = optimum_from(problem, problem.dead_reckoning)
    else:
        found = bearing_only_optimum(problem, lambda: incremental_start(problem)[0])
    return with_association(found, association)


def bearing_only_optimum(recording: Problem, incremental_path: Callable[[], Float]) -> Estimate:
    """Return `batch` of a bearing-only recording; `incremental_path` computes the path (N+1, 3) of `causal`."""
    path = recording.dead_reckoning
    with suppress(UndeterminedError):
        taken, found = placed_minimum(recording, path, _starts)
        if (taken >= 0).all():
            return _estimate(recording, taken, found)
    with suppress(UndeterminedError):
        path = incremental_path()
    return optimum_from(recording, path)


def optimum_from(recording: Problem, path: Float) -> Estimate:
    """Return `batch` with the path (N+1, 3) as first start."""
    return _estimate(recording, *placed_minimum(recording, path, _starts))


def optimum_near(recording: Problem, path: Float, landmarks: Float) -> Estimate:
    """Return `batch` with the path (N+1, 3) and map (L, 2) of all landmarks, ids increasing, as first start."""
    starts = itertools.chain([lambda: (path, landmarks)], _starts(recording, path))
    return _estimate(recording, recording.landmark, lowest_minimum(recording, starts))


def _estimate(recording: Problem, taken: Int, found: Minimum) -> Estimate:
    return Estimate(
        kind="smoothed",
        poses=found.poses,
        pose_covs=without_negative_eigenvalues(found.solution.pose_covs),
        landmark_ids=np.unique(taken[taken >= 0]),
        landmarks=found.landmarks,
        landmark_covs=found.solution.landmark_covs,
        association=taken,
        chi_square=2.0 * found.cost,
        chi_square_dof=degrees_of_freedom(recording.associated(taken)),
    )


def incremental_start(recording: Problem, most_switches: float = np.inf) -> tuple[Float, Float]:
    """Return poses and landmarks of the incremental optimum.

    Raises:
        UndeterminedError: some first steps have no minimum, or it has switched to other minima too often.
    """
    incremental = IncrementalOptimum(recording)
    for _ in range(recording.steps + 1):
        incremental.add_step()
        if not incremental.converged:
            raise UndeterminedError("batch: the first steps alone have no minimum; check ids and covariances")
        if len(incremental.switches) > most_switches:
            raise UndeterminedError("batch: the first steps have many minima; check ids and covariances")
    return start_of(incremental, recording)


def start_of(incremental: IncrementalOptimum, recording: Problem) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2) of an incremental optimum.

    Inactive landmarks are at the median of their observations.
    """
    poses, found = incremental.path_and_map()
    landmarks = landmarks_at_median(recording, poses)
    landmarks[np.isin(recording.landmark_ids, incremental.landmark_ids)] = found
    return poses, landmarks


def _starts(recording: Problem, path: Float) -> Iterator[Start]:
    """Yield functions that return starting poses (N+1, 3) and landmarks (L, 2), the most promising first."""
    odometry = recording.dead_reckoning
    yield lambda: descent_start(recording, path)
    if SENSORS[recording.sensor].places_landmarks:
        yield lambda: surrogate_start(recording)
    yield lambda: inflated_noise_start(recording, path)
    if np.array_equal(path, odometry):
        yield lambda: incremental_start(recording, MOST_SWITCHES)
    else:
        yield lambda: descent_start(recording, odometry)
    yield lambda: growing_start(recording)
    yield lambda: (odometry, landmarks_at_median(recording, odometry))
