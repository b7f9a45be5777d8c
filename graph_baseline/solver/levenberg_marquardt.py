"""Minimisation of the exact cost of a recording from a start: Levenberg-Marquardt steps, then Gauss-Newton steps.

The Schur complement (`smoother`) gives the steps; zero variances are constraints. A step satisfies them to first
order, then the path is projected on the constraints (`retraction`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.linalg import LinAlgError

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.problem.objective import Objective, Point
from slamgauge.graph_baseline.problem.placement import least_known_landmark
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.problem.retraction import retract_by_motions, retract_pointwise
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError, undetermined_variable
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration, largest_entry
from slamgauge.graph_baseline.solver.smoother import EXACT, NOT_DAMPED, Damping, Solution, damped_step, solve
from slamgauge.sensors import SENSORS

MAX_DAMPED_STEPS = 200
NEAR = 1e-6  # damped steps stop at this decrease of the cost, relative to the cost and to its expected value
GENTLE, STRONGER, WEAKER, UNDAMPED = 1e-4, 10.0, 0.1, 1e-8  # damping relative to the mean information of a scan

MAX_NEWTON_STEPS = 60
NEGLIGIBLE = 1e-8  # size of a step that ends the iteration [standard deviations]
RESOLVED = 1e-3  # largest last step that counts as rounding, if residuals fit the noise [standard deviations]
LARGEST_MISFIT = 10.0  # largest factor on RESOLVED for residuals above the noise: rounding grows with them
STALLED = 6  # largest number of steps without a new smallest step
HOPELESS = 1e6  # size of a step at which the iteration diverges [standard deviations]
RISEN = 1e-3  # relative increase of the cost that shows that Gauss-Newton converged to another stationary point
TOO_NEAR = 1e-4  # smallest distance of a landmark and a pose that observes it [m]


class Minimum(NamedTuple):
    """Poses (N+1, 3), landmarks (L, 2) in increasing id order, covariances, and half the squared residuals."""

    poses: Float
    landmarks: Float
    solution: Solution
    cost: float


def damped_descent(objective: Objective, poses: Float, landmarks: Float, most: int = MAX_DAMPED_STEPS) -> Point:
    """Take Levenberg-Marquardt steps until the decrease of the cost is small.

    Args:
        objective: cost.
        poses: (N+1, 3) starting path.
        landmarks: (L, 2) starting map.
        most: largest number of steps.
    """
    point = objective.at(objective.noise.satisfying_constraints(poses), landmarks)
    factor, expected = 0.0, 1.0 + objective.problem.observation.size / 2.0
    for _ in range(most):
        scale = _mean_information(point.model, objective.problem)
        tried = _damped_trial(objective, point, scale, factor)
        while tried.cost > point.cost and factor < 1.0 / UNDAMPED:
            factor = max(STRONGER * factor, GENTLE)
            tried = _damped_trial(objective, point, scale, factor)
        if tried.cost > point.cost or tried.cost == np.inf:
            break
        decrease, point = point.cost - tried.cost, tried
        factor = WEAKER * factor if factor > UNDAMPED else 0.0
        if decrease <= NEAR * max(point.cost, expected):
            break
    return point


def minimum_at(objective: Objective, point: Point) -> Minimum:
    """Return a point with its covariances.

    Raises:
        UndeterminedError: the observations do not determine the landmarks.
    """
    try:
        solution = solve(point.model, objective.scans, len(point.landmarks))
    except LinAlgError:
        raise undetermined_variable("l", least_known_landmark(objective.problem)[0]) from None
    return Minimum(point.poses, point.landmarks, solution, point.cost)


def _damped_trial(objective: Objective, point: Point, scale: Damping, factor: float) -> Point:
    """Return the point after a damped step with the better retraction; its cost is infinite if no step exists."""
    damping = Damping(factor * scale.pose, factor * scale.landmark, factor * scale.motion)
    try:
        step = damped_step(point.model, objective.scans, len(point.landmarks), damping)
        ways = [
            retract(objective.problem, objective.noise, point.poses, point.landmarks, *step)
            for retract in (retract_pointwise, retract_by_motions)
        ]
    except LinAlgError:
        return point._replace(cost=np.inf)
    return min((objective.at(*way) for way in ways), key=lambda each: each.cost)


def _mean_information(model: LinearModel, problem: Problem) -> Damping:
    """Return the mean information of a scan about its pose and its motion, and of all scans about a landmark."""
    scans = max(len(np.unique(problem.observation_step)), 1)
    by_pose = np.square(model.Hx).sum(axis=(0, 1)) / scans
    by_pose[:2] = by_pose[:2].mean()
    by_landmark = float(np.square(model.Hm).sum()) / (2 * max(len(problem.landmark_ids), 1))
    by_motion = float(np.einsum("nii,i->", model.W[1:], by_pose)) / max(problem.steps, 1)
    return Damping(by_pose, by_landmark, by_motion)


def gauss_newton_minimum(objective: Objective, start: Point) -> Minimum:
    """Take Gauss-Newton steps until they are negligible or limited by rounding; return the minimum.

    Gauss-Newton neglects the second derivatives of residuals. With large residuals it converges slowly or not at all,
    so its steps are accelerated (`anderson`).

    Raises:
        UndeterminedError: no minimum exists, or rounding prevents convergence.
    """
    _refuse_landmarks_at_poses(objective.problem, start)
    weight, acceleration = _inverse_sigmas(minimum_at(objective, start).solution), AndersonAcceleration()
    point, best, smallest, stalled = start, start, np.inf, 0
    for _ in range(MAX_NEWTON_STEPS):
        try:
            dx, dm = damped_step(point.model, objective.scans, len(point.landmarks), NOT_DAMPED)
        except LinAlgError:
            break
        step = np.concatenate([dx.ravel(), dm.ravel()])
        size = largest_entry(weight * step)
        stalled = 0 if size < smallest else stalled + 1
        if size < smallest:
            best, smallest = point, size
        if stalled > STALLED or not size < HOPELESS:
            break
        move = step if size < NEGLIGIBLE else acceleration.accelerate(step, weight * step)
        acceleration.record(move)
        moves = move[: dx.size].reshape(-1, 3), move[dx.size :].reshape(-1, 2)
        point = objective.at(
            *retract_pointwise(objective.problem, objective.noise, point.poses, point.landmarks, *moves)
        )
        if size < NEGLIGIBLE:
            best = point
            break
    misfit = np.sqrt(2.0 * start.cost / max(objective.problem.observation.size, 1))
    if not smallest < RESOLVED * np.clip(misfit, 1.0, LARGEST_MISFIT):
        raise UndeterminedError(_why_no_minimum(objective, best, smallest))
    if best.cost > start.cost + RISEN * (1.0 + start.cost):
        raise UndeterminedError(
            f"batch: no minimum, the last steps increase the cost by {best.cost - start.cost:.2g} nats: the "
            "measurements hardly determine a direction; add observations with smaller covariances or from other places"
        )
    return minimum_at(objective, best)


def _inverse_sigmas(solution: Solution) -> Float:
    """Return 1 / sigma of all poses and landmarks, (3N+3+2L,); zero for exact ones."""
    covs = (solution.pose_covs, solution.landmark_covs)
    sigmas = np.sqrt(np.maximum(np.concatenate([np.diagonal(each, axis1=1, axis2=2).ravel() for each in covs]), 0.0))
    return np.divide(1.0, sigmas, out=np.zeros_like(sigmas), where=sigmas > EXACT)


def _refuse_landmarks_at_poses(problem: Problem, point: Point) -> None:
    """Raise if a landmark is at a pose that observes it, where range and bearing are not smooth."""
    if not SENSORS[problem.sensor].has_bearing or not len(problem.slot):
        return
    distance = np.hypot(*(point.landmarks[problem.slot] - point.poses[problem.observation_step, :2]).T)
    row = int(np.argmin(distance))
    if distance[row] < TOO_NEAR:
        raise UndeterminedError(
            f"batch: no minimum, landmark {problem.landmark[row]} moves to {distance[row]:.2g} m "
            f"from pose {problem.observation_step[row]} that observes it, where range and bearing are not smooth; "
            "check ids and covariances"
        )


def _why_no_minimum(objective: Objective, point: Point, size: float) -> str:
    """Return a message with the last step and the largest residual at the end of the iteration."""
    misfit = np.sqrt(objective.squared_residuals(point))
    opening = f"batch: no minimum, the last step is of {size:.2g} sigma"
    worst = int(np.argmax(np.nan_to_num(misfit, nan=np.inf))) if len(misfit) else -1
    if worst >= 0 and not misfit[worst] < 6.0:
        return (
            f"{opening}; observation {worst} of landmark {objective.problem.landmark[worst]} has the largest residual, "
            f"{misfit[worst]:.2g} sigma: check ids and covariances, or run robust-batch"
        )
    return f"{opening}: double precision cannot resolve these covariances; reduce the ratio of largest and smallest"
