"""The hindsight optimum: all measurements at once, every pose and landmark with its covariance.

1. GTSAM's Levenberg-Marquardt runs from two starts, dead reckoning (which ends in a local minimum on
   Victoria Park) and one that is grown portion by portion; the lower cost is kept. Motion directions of
   zero variance are lent a small slip for this, because damping and hard constraints do not agree:
   damped steps leave the constraint and stop early.
2. Exact Newton steps through the Schur complement (see `smoother`) finish on the recording's own model,
   zero variances and all, until a step is negligible against the standard deviations it has found.
   The gradient vanishes there, and positive definite information makes it a minimum.
"""

from __future__ import annotations

import gtsam
import numpy as np

from graph_baseline.factors import (
    LENT_SLIP,
    build_graph,
    first_sights,
    landmarks_at_first_sight,
    make_values,
    read_values,
    require_known_landmarks,
)
from graph_baseline.linearisation import cost, linearise
from graph_baseline.smoother import Solution, solve
from graph_baseline.undetermined import UndeterminedError, explained, undetermined_variable
from slam2d import Estimate, Float, Int, Recording, chain, wrap

PORTIONS = 8  # of the recording, in the grown start
MAX_NEWTON_STEPS = 30
NEGLIGIBLE = 1e-6  # of a standard deviation


def batch(recording: Recording) -> Estimate:
    """What the measurements allow in hindsight: the maximum a posteriori trajectory and map.

    Raises:
        ValueError: the recording cannot be turned into a graph, leaves a variable undetermined, or the
            optimum was not reached.
    """
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


def minimise(recording: Recording, graph: gtsam.NonlinearFactorGraph) -> tuple[Float, Float]:
    """Poses and landmarks of the lower of two Levenberg-Marquardt solutions of `graph`, slip lent."""
    with explained():
        starts = [_grown_start(recording), _extended(recording, np.zeros((0, 3)), {})]
        solutions = [_levenberg_marquardt(graph, values) for values in starts]
    return read_values(min(solutions, key=graph.error))


def _grown_start(recording: Recording) -> gtsam.Values:
    """A few iterations on the first portion of the recording, then on more and more of it."""
    poses, known = np.zeros((0, 3)), dict[int, Float]()
    for portion in range(1, PORTIONS):
        part = recording.first(recording.steps * portion // PORTIONS)
        values = _extended(part, poses, known)
        poses, landmarks = read_values(_levenberg_marquardt(build_graph(part, LENT_SLIP), values, iterations=2))
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


def _levenberg_marquardt(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int = 100
) -> gtsam.Values:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-5)
    parameters.setMaxIterations(iterations)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()


def finish(recording: Recording, landmark_ids: Int, poses: Float, landmarks: Float) -> tuple[Float, Float, Solution]:
    """Newton steps on the exact model until they are negligible; the solution's covariances with it."""
    slot = np.searchsorted(landmark_ids, require_known_landmarks(recording))
    for _ in range(MAX_NEWTON_STEPS):
        try:
            solution = solve(linearise(recording, slot, poses, landmarks), len(landmark_ids))
        except np.linalg.LinAlgError:
            raise undetermined_variable("l", _weakest_landmark(recording, landmark_ids, slot)) from None
        poses, landmarks = poses + solution.dx, landmarks + solution.dm
        poses[:, 2] = wrap(poses[:, 2])
        if _relative_size(solution) < NEGLIGIBLE:
            return poses, landmarks, solution
    reached = cost(recording, poses, landmark_ids, landmarks)
    raise UndeterminedError(
        f"batch: no minimum after {MAX_NEWTON_STEPS} exact steps (cost {reached:g}); "
        "the measurements contradict each other: check associations and covariances"
    )


def _relative_size(solution: Solution) -> float:
    """Largest component of the step in units of its own standard deviation."""
    sizes = [0.0]
    for step, covs in ((solution.dx, solution.pose_covs), (solution.dm, solution.landmark_covs)):
        sigma = np.sqrt(np.maximum(np.diagonal(covs, axis1=1, axis2=2), 0.0))
        sizes.append(float(np.max(np.abs(step) / np.where(sigma > 1e-9, sigma, np.inf), initial=0.0)))
    return max(sizes)


def _weakest_landmark(recording: Recording, landmark_ids: Int, slot: Int) -> int:
    """Id of the landmark that its own observations tell least about."""
    precision = np.zeros(len(landmark_ids))
    np.add.at(precision, slot, 1.0 / np.linalg.eigvalsh(recording.observation_cov)[:, -1])
    return int(landmark_ids[np.argmin(precision)])
