"""The hindsight optimum: all poses and landmarks with their covariances, given all measurements.

1. Damped steps (`levenberg_marquardt`) from a path, by default dead reckoning, approach a minimum of the exact cost, in
   which zero variances are constraints.
2. If the stated noise explains the cost (chi-square test), the search ends, but with bearings of a short recording only
   after two starts have led to the lowest minimum. Otherwise a robust fit and the path of the causal optimum are
   further starts: no start fits data that contradict their model.
3. Gauss-Newton steps converge to the lowest minimum.

A bearing-only landmark is added if its bearings place it from the optimum without it, and removed if the optimum with
it no longer places it. Unless all landmarks are placed, the search is repeated from the path of the causal optimum,
which places more landmarks than dead reckoning.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import Problem, prepare, relative_to_start, with_association
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum
from slamgauge.graph_baseline.solver.robust_fit import robust_fit
from slamgauge.graph_baseline.solver.search import Start, degrees_of_freedom, placed_minimum
from slamgauge.graph_baseline.solver.smoother import require_memory_for
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS


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
    path = problem.dead_reckoning
    if not SENSORS[recording.sensor].places_landmarks:
        with suppress(UndeterminedError):
            found = optimum_from(problem, path)
            if len(found.landmark_ids) == len(problem.landmark_ids):
                return with_association(found, association)
        with suppress(UndeterminedError):
            path = incremental_start(problem)[0]
    return with_association(optimum_from(problem, path), association)


def optimum_from(problem: Problem, path: Float, landmarks: Float | None = None) -> Estimate:
    """Return `batch` with the path (N+1, 3) as first start, or first with the map (L, 2) of all landmarks, too."""

    def starts(part: Problem, path: Float) -> Iterator[Start]:
        if landmarks is not None:
            yield lambda: (path, landmarks)
        yield from _starts(part, path)

    taken, found = placed_minimum(problem, path, starts)
    return Estimate(
        kind="smoothed",
        poses=found.poses,
        pose_covs=without_negative_eigenvalues(found.solution.pose_covs),
        landmark_ids=np.unique(taken[taken >= 0]),
        landmarks=found.landmarks,
        landmark_covs=found.solution.landmark_covs,
        association=taken,
        chi_square=2.0 * found.cost,
        chi_square_dof=degrees_of_freedom(problem.associated(taken)),
    )


def incremental_start(problem: Problem) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2) of the incremental optimum.

    Inactive landmarks are at the median of their observations.

    Raises:
        UndeterminedError: some first steps have no minimum.
    """
    incremental = IncrementalOptimum(problem)
    for _ in range(problem.steps + 1):
        incremental.add_step()
        if not incremental.converged:
            raise UndeterminedError("batch: the first steps alone have no minimum; check ids and covariances")
    poses, found = incremental.path_and_map()
    landmarks = landmarks_at_median(problem, poses)
    landmarks[np.isin(problem.landmark_ids, incremental.landmark_ids)] = found
    return poses, landmarks


def _starts(problem: Problem, path: Float) -> Iterator[Start]:
    """Yield functions that return starting poses (N+1, 3) and landmarks (L, 2): from the path, and others.

    The robust fit takes a fifth of the time of the incremental optimum. For bearing-only recordings it is the last
    start, because their landmarks depend on the path.
    """
    odometry, places_landmarks = problem.dead_reckoning, SENSORS[problem.sensor].places_landmarks
    yield lambda: (path, landmarks_at_median(problem, path))
    if places_landmarks:
        yield lambda: robust_fit(problem)[:2]
    if np.array_equal(path, odometry):
        yield lambda: incremental_start(problem)
    else:
        yield lambda: (odometry, landmarks_at_median(problem, odometry))
    if not places_landmarks:
        yield lambda: robust_fit(problem)[:2]
