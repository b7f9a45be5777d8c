"""Minimisation of the exact cost of a recording from a start: Levenberg-Marquardt steps, then Gauss-Newton steps.

The Schur complement (`smoother`) gives the steps; zero variances are constraints. A step satisfies them to first
order, then the path is projected on the constraints (`retraction`).
"""

from __future__ import annotations

from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.linalg import LinAlgError

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import LinearModel, linearise, whitened_residuals
from slamgauge.graph_baseline.problem.preparation import Problem, require_placeable
from slamgauge.graph_baseline.problem.retraction import MotionNoise, retract_by_motions, retract_pointwise
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration, largest_entry
from slamgauge.graph_baseline.solver.reduced_scans import NOT_DAMPED, Damping
from slamgauge.graph_baseline.solver.smoother import Solution, damped_step, solve_at
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS

MAX_STEPS = 200
NEAR = 1e-6  # damped steps stop at this decrease of the cost, relative to the cost and to its expected value
TOO_NEAR = 1e-4  # smallest distance of a landmark and a pose that observes it [m]
RISEN = 1e-3  # relative increase of the cost that shows that Gauss-Newton converged to another stationary point
NEGLIGIBLE = 1e-8  # size of a step that ends the iteration [standard deviations]
RESOLVED = 1e-3  # largest last step that counts as rounding, if residuals fit the noise [standard deviations]
MISFIT = 10.0  # largest factor on RESOLVED for residuals larger than the noise, because rounding grows with them
PATIENCE = 6  # largest number of steps without a new smallest step
HOPELESS = 1e6  # size of a step at which the iteration diverges [standard deviations]
EXACT = 1e-9  # a smaller standard deviation is treated as zero [m or rad]
MAX_NEWTON_STEPS = 60
GENTLE, STRONGER, WEAKER, UNDAMPED = 1e-4, 10.0, 0.1, 1e-8  # damping relative to the mean information of a scan


class Minimum(NamedTuple):
    """Poses (N+1, 3), landmarks (L, 2) in increasing id order, covariances, and half the squared residuals."""

    poses: Float
    landmarks: Float
    solution: Solution
    cost: float


class NearMinimum(NamedTuple):
    """Poses (N+1, 3) and landmarks (L, 2) near a minimum, and half their squared residuals."""

    poses: Float
    landmarks: Float
    cost: float
    merit: Merit


class Merit:
    """Cost of paths and maps of a recording that satisfy the constraints of zero variances."""

    def __init__(self, recording: Problem) -> None:
        self._recording = recording
        self.noise = MotionNoise(recording)

    def __call__(self, poses: Float, landmarks: Float) -> float:
        """Return half the sum of squared whitened residuals, infinite if it is undefined."""
        with np.errstate(all="ignore"):
            seen = whitened_residuals(self._recording, self._recording.slot, poses, landmarks)
            cost = self.noise.cost(poses) + 0.5 * float(np.square(seen).sum())
        return cost if np.isfinite(cost) else np.inf


def damped_descent(recording: Problem, poses: Float, landmarks: Float, most: int = MAX_STEPS) -> NearMinimum:
    """Take Levenberg-Marquardt steps until the decrease of the cost is small.

    Args:
        recording: known association.
        poses: (N+1, 3) starting path.
        landmarks: (L, 2) starting map.
        most: largest number of steps.
    """
    merit = Merit(recording)
    poses = merit.noise.satisfying_constraints(poses)
    cost, factor, expected = merit(poses, landmarks), 0.0, 1.0 + recording.observation.size / 2.0
    for _ in range(most):
        model = linearise(recording, recording.slot, poses, landmarks)
        scale = _mean_information(model, len(landmarks))
        while True:
            found, tried = _damped_trial(model, merit, poses, landmarks, scale, factor)
            if found <= cost or factor > 1.0 / UNDAMPED:
                break
            factor = max(STRONGER * factor, GENTLE)
        if found > cost:
            break
        decrease, cost, (poses, landmarks) = cost - found, found, tried
        factor = WEAKER * factor if factor > UNDAMPED else 0.0
        if decrease <= NEAR * max(cost, expected):
            break
    return NearMinimum(poses, landmarks, cost, merit)


def descend(recording: Problem, poses: Float, landmarks: Float, iterations: int = 40) -> tuple[Float, Float]:
    """Return path and map after damped steps; replaces GTSAM's optimiser (`gtsam_start`) if it is not installed."""
    require_placeable(recording)
    found = damped_descent(recording, poses, landmarks, iterations)
    return found.poses, found.landmarks


def _damped_trial(
    model: LinearModel, merit: Merit, poses: Float, landmarks: Float, scale: Damping, factor: float
) -> tuple[float, tuple[Float, Float]]:
    """Return cost, path and map after a damped step with the better retraction; infinite cost if no step exists."""
    damping = Damping(factor * scale.pose, factor * scale.landmark, factor * scale.motion)
    try:
        step = damped_step(model, len(landmarks), damping)
        ways = [move(model, merit.noise, poses, landmarks, *step) for move in (retract_pointwise, retract_by_motions)]
    except LinAlgError:
        return np.inf, (poses, landmarks)
    return min(((merit(*way), way) for way in ways), key=itemgetter(0))


def _mean_information(model: LinearModel, landmarks: int) -> Damping:
    """Return the mean information of a scan about its pose and its motion, and of all scans about a landmark."""
    poses = max(len(np.unique(model.step)), 1)
    by_pose = np.square(model.Hx).sum(axis=(0, 1)) / poses
    by_pose[:2] = by_pose[:2].mean()
    by_landmark = float(np.square(model.Hm).sum()) / (2 * max(landmarks, 1))
    by_motion = float(np.einsum("nii,i->", model.W, by_pose)) / max(len(model.W), 1)
    return Damping(by_pose, by_landmark, by_motion)


def gauss_newton_minimum(recording: Problem, start: NearMinimum) -> Minimum:
    """Take Gauss-Newton steps until they are negligible or limited by rounding; return the minimum.

    Gauss-Newton neglects the second derivatives of residuals. With large residuals it converges slowly or not at all,
    so its steps are accelerated (`anderson`).

    Raises:
        UndeterminedError: no minimum exists, or rounding prevents convergence.
    """
    poses, landmarks, cost, merit = start
    _refuse_landmarks_at_poses(recording, poses, landmarks)
    sigmas = _sigmas(solve_at(recording, *start[:2]))
    weight, acceleration = 1.0 / np.concatenate([each.ravel() for each in sigmas]), AndersonAcceleration()
    best, smallest, stalled = (poses, landmarks), np.inf, 0
    for _ in range(MAX_NEWTON_STEPS):
        model = linearise(recording, recording.slot, poses, landmarks)
        try:
            step = damped_step(model, len(landmarks), NOT_DAMPED)
        except LinAlgError:
            break
        ahead = retract_pointwise(model, merit.noise, poses, landmarks, *step)
        apart = _apart(ahead, (poses, landmarks))
        size = largest_entry(weight * apart)
        if size < smallest:
            best, smallest, stalled = (poses, landmarks), size, 0
        else:
            stalled += 1
        if size < NEGLIGIBLE:
            best = ahead
        if size < NEGLIGIBLE or stalled > PATIENCE or not size < HOPELESS:
            break
        before = poses, landmarks
        poses, landmarks = _displaced(before, acceleration.accelerate(apart, weight * apart), merit.noise)
        acceleration.record(_apart((poses, landmarks), before))
    misfit = np.sqrt(2.0 * cost / max(recording.observation.size, 1))
    if not smallest < RESOLVED * np.clip(misfit, 1.0, MISFIT):
        raise UndeterminedError(_why_no_minimum(recording, *best, smallest))
    ended = merit(*best)
    if ended > cost + RISEN * (1.0 + cost):
        raise UndeterminedError(
            f"batch: no minimum, the last steps increase the cost by {ended - cost:.2g} nats: the measurements hardly "
            "determine a direction; add observations with smaller covariances or from other places"
        )
    return Minimum(*best, solve_at(recording, *best), ended)


def _apart(point: tuple[Float, Float], other: tuple[Float, Float]) -> Float:
    """Return the difference (3N+3+2L,) of two points, which contain poses and landmarks."""
    poses, landmarks = (a - b for a, b in zip(point, other, strict=True))
    poses[:, 2] = wrap(poses[:, 2])
    return np.concatenate([poses.ravel(), landmarks.ravel()])


def _displaced(point: tuple[Float, Float], move: Float, noise: MotionNoise) -> tuple[Float, Float]:
    """Return poses and landmarks after a move (3N+3+2L,), projected on the constraints of zero variances."""
    poses, landmarks = point
    path = poses + move[: poses.size].reshape(poses.shape)
    path[:, 2] = wrap(path[:, 2])
    return noise.satisfying_constraints(path), landmarks + move[poses.size :].reshape(landmarks.shape)


def _sigmas(solution: Solution) -> tuple[Float, Float]:
    """Return standard deviations of poses (N+1, 3) and landmarks (L, 2); zeros are replaced by infinity."""
    covs = (solution.pose_covs, solution.landmark_covs)
    poses, landmarks = (np.sqrt(np.maximum(np.diagonal(each, axis1=1, axis2=2), 0.0)) for each in covs)
    return np.where(poses > EXACT, poses, np.inf), np.where(landmarks > EXACT, landmarks, np.inf)


def _refuse_landmarks_at_poses(recording: Problem, poses: Float, landmarks: Float) -> None:
    """Raise if a landmark is at a pose that observes it, where range and bearing are not smooth."""
    if not SENSORS[recording.sensor].has_bearing or not len(recording.slot):
        return
    distance = np.hypot(*(landmarks[recording.slot] - poses[recording.observation_step, :2]).T)
    row = int(np.argmin(distance))
    if distance[row] < TOO_NEAR:
        raise UndeterminedError(
            f"batch: no minimum, landmark {recording.landmark[row]} moves to {distance[row]:.2g} m "
            f"from pose {recording.observation_step[row]} that observes it, where range and bearing are not smooth; "
            "check ids and covariances"
        )


def _why_no_minimum(recording: Problem, poses: Float, landmarks: Float, size: float) -> str:
    """Return a message with the last step and the largest residual at the end of the iteration."""
    with np.errstate(all="ignore"):
        misfit = np.sqrt(np.square(whitened_residuals(recording, recording.slot, poses, landmarks)).sum(axis=1))
    opening = f"batch: no minimum, the last step is of {size:.2g} sigma"
    worst = int(np.argmax(np.nan_to_num(misfit, nan=np.inf))) if len(misfit) else -1
    if worst >= 0 and not misfit[worst] < 6.0:
        return (
            f"{opening}; observation {worst} of landmark {recording.landmark[worst]} has the largest residual, "
            f"{misfit[worst]:.2g} sigma: check ids and covariances, or run robust-batch"
        )
    return f"{opening}: double precision cannot resolve these covariances; reduce the ratio of largest and smallest"
