"""The hindsight optimum: all measurements at once, every pose and landmark with its covariance.

1. GTSAM's Levenberg-Marquardt runs from dead reckoning. A cost that the stated noise explains (two-sided
   chi-square band of its degrees of freedom) ends the search; otherwise, as on Victoria Park, where dead
   reckoning ends in a local minimum, it also runs from a start that is grown portion by portion, and the
   lower cost is kept. Motion directions of zero variance are lent a small slip for this, because damping
   and hard constraints do not agree: damped steps leave the constraint and stop early.
2. Exact Newton steps through the Schur complement (see `smoother`) finish on the recording's own model,
   zero variances and all, until a step is negligible against the standard deviations it has found.
   The gradient vanishes there, and positive definite information makes it a minimum.
"""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
from scipy.special import chdtr

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.factors import (
    LENT_SLIP,
    build_graph,
    first_sights,
    landmarks_at_first_sight,
    make_values,
    placed_alone,
    read_values,
    require_known_landmarks,
)
from slamgauge.graph_baseline.smoother import Solution, solve_at
from slamgauge.graph_baseline.undetermined import UndeterminedError, explained
from slamgauge.recording import Recording
from slamgauge.se2 import chain, wrap

PORTIONS = 8  # of the recording, in the grown start
MAX_NEWTON_STEPS = 30
NEGLIGIBLE = 1e-6  # of a standard deviation
OUTSIDE_BAND = 1e-3  # probability that true noise makes a cost that is taken for unexplained


def batch(recording: Recording, association: Int | None = None) -> Estimate:
    """What the measurements allow in hindsight: the maximum a posteriori trajectory and map.

    Args:
        recording: what was measured.
        association: (M,) ids in place of the recording's own, an `Estimate.association` for instance; -1 leaves
            an observation out.

    Raises:
        UserError: the recording cannot be turned into a graph, leaves a variable undetermined, or the
            optimum was not reached.
    """
    if association is not None:
        return among_mapped(batch(recording.associated(association)), association)
    placed = placed_alone(recording)
    if placed is not None:
        return batch(recording, placed)
    landmark_ids = first_sights(recording)[0]
    poses, landmarks = minimise(recording, build_graph(recording, LENT_SLIP))
    poses, landmarks, solution = finish(recording, landmark_ids, poses, landmarks)
    return Estimate(
        kind="smoothed",
        poses=poses,
        pose_covs=solution.pose_covs,
        landmark_ids=landmark_ids,
        landmarks=landmarks,
        landmark_covs=solution.landmark_covs,
        association=recording.landmark,
    )


def among_mapped(estimate: Estimate, association: Int) -> Estimate:
    """The estimate for an association (M,) of its own; -1 for what was given to landmarks that are not mapped."""
    mapped = np.isin(association, np.asarray(estimate.landmark_ids))
    return replace(estimate, association=np.where(mapped, association, -1))


def minimise(recording: Recording, graph: gtsam.NonlinearFactorGraph) -> tuple[Float, Float]:
    """Poses and landmarks of the lowest Levenberg-Marquardt solution of `graph`, slip lent."""
    with explained():
        solution = levenberg_marquardt(graph, _extended(recording, np.zeros((0, 3)), {}))
        if not _as_noise_allows(recording, graph.error(solution)):
            second = levenberg_marquardt(graph, _grown_start(recording))
            solution = min(solution, second, key=graph.error)
    return read_values(solution)


def _as_noise_allows(recording: Recording, cost: float) -> bool:
    """Whether twice the optimum's cost lies in the two-sided band of its chi-square distribution.

    Rows less unknowns is the rows of every observation less two for every landmark.
    """
    freedom = recording.observation.size - 2 * len(first_sights(recording)[0])
    return OUTSIDE_BAND / 2 < chdtr(freedom, 2.0 * cost) < 1.0 - OUTSIDE_BAND / 2


def _grown_start(recording: Recording) -> gtsam.Values:
    """A few iterations on the first portion of the recording, then on more and more of it."""
    poses, known = np.zeros((0, 3)), dict[int, Float]()
    for portion in range(1, PORTIONS):
        part = recording.first(recording.steps * portion // PORTIONS)
        placed = placed_alone(part)
        part = part if placed is None else part.associated(placed)
        values = _extended(part, poses, known)
        poses, landmarks = read_values(levenberg_marquardt(build_graph(part, LENT_SLIP), values, iterations=2))
        known = dict(zip(first_sights(part)[0].tolist(), landmarks, strict=True))
    return _extended(recording, poses, known)


def _extended(recording: Recording, poses: Float, known: dict[int, Float]) -> gtsam.Values:
    """The first `poses` carried on by odometry, with landmarks that are not `known` at their first sight."""
    done = len(poses)
    last = poses[-1] if done else recording.prior_mean
    path = np.concatenate([poses[:-1], chain(last, recording.odometry[max(done - 1, 0) :])])
    landmark_ids = first_sights(recording)[0]
    landmarks = landmarks_at_first_sight(recording, path)
    for slot, name in enumerate(landmark_ids.tolist()):
        landmarks[slot] = known.get(name, landmarks[slot])
    return make_values(path, landmark_ids, landmarks)


def levenberg_marquardt(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int = 100) -> gtsam.Values:
    """The minimum that GTSAM's Levenberg-Marquardt reaches from `values`, to be finished by exact steps (`finish`)."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-5)
    parameters.setMaxIterations(iterations)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()


def finish(recording: Recording, landmark_ids: Int, poses: Float, landmarks: Float) -> tuple[Float, Float, Solution]:
    """Newton steps on the exact model until they are negligible; the solution's covariances with it."""
    for _ in range(MAX_NEWTON_STEPS):
        solution = solve_at(recording, landmark_ids, poses, landmarks)
        poses, landmarks = poses + solution.dx, landmarks + solution.dm
        poses[:, 2] = wrap(poses[:, 2])
        if _relative_size(solution) < NEGLIGIBLE:
            return poses, landmarks, solution
    positions = landmarks[np.searchsorted(landmark_ids, require_known_landmarks(recording))]
    raise UndeterminedError(_why_no_minimum(recording, poses, positions))


def _why_no_minimum(recording: Recording, poses: Float, positions: Float) -> str:
    """One line, where the observed landmarks lie at `positions` (M, 2)."""
    seen = require_known_landmarks(recording)
    distance = np.hypot(*(positions - poses[recording.observation_step, :2]).T)
    row = int(np.argmin(distance))
    return (
        f"batch: no minimum after {MAX_NEWTON_STEPS} exact steps; check associations and covariances, or drop "
        f"observation {row}: it sees landmark {seen[row]} from {distance[row]:.2g} m, the nearest of all, and on the "
        "robot itself neither range nor bearing is smooth"
    )


def _relative_size(solution: Solution) -> float:
    """Largest component of the step in units of its own standard deviation."""
    sizes = [0.0]
    for step, covs in ((solution.dx, solution.pose_covs), (solution.dm, solution.landmark_covs)):
        sigma = np.sqrt(np.maximum(np.diagonal(covs, axis1=1, axis2=2), 0.0))
        sizes.append(float(np.max(np.abs(step) / np.where(sigma > 1e-9, sigma, np.inf), initial=0.0)))
    return max(sizes)
