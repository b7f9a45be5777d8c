"""A recording as a GTSAM factor graph: the whole graph at once, or the factors that each step adds.

Variables are poses X(k), k = 0..N, and landmarks L(id). Factors are GTSAM's built-in ones: a prior on X(0), one
`BetweenFactorPose2` per odometry increment, one `BearingRangeFactor2D` or `BearingFactor2D` per observation.

Two parts of a recording have no direct counterpart in GTSAM:

- GTSAM has no planar factor for the `position` sensor. An observation becomes a range and a bearing with the
  covariance J R J', where J is the Jacobian of the conversion at the measured point. On small recordings the optimum of
  this graph is 0.01 to 0.06 standard deviations away from the optimum of the position model.
- A variance of zero, for example of a robot without lateral slip, becomes a constrained noise model. GTSAM's damped and
  incremental solvers do not converge well with constraints, so they use regularising noise (`REGULARISING_NOISE`).
"""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int
from slamgauge.back_projection import positions_seen
from slamgauge.graph_baseline.problem.placement import triangulate_one
from slamgauge.graph_baseline.problem.preparation import (
    as_range_bearing,
    prepare,
    prior_cov_in_body,
    require_placeable,
)
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.sensors import SENSORS

# Standard deviation in a direction of zero variance, relative to the largest standard deviation of the same step:
# 0.1 mm for the robot of the exercise, with 30 mm along the heading.
REGULARISING_NOISE = 1.0 / 300.0


class GraphBuilder:
    """Factors of a recording with known association.

    Args:
        recording: its bearings must place all bearing-only landmarks (see `are_placed`).
        regularising: standard deviation that replaces zero, relative to the largest of the same step (for the prior:
            the largest of the prior and the first step); 0 keeps zero variances as constraints.

    Raises:
        UserError: the association is unknown, or the observations do not determine a landmark.
    """

    def __init__(self, recording: Recording, regularising: float = 0.0) -> None:
        problem = prepare(recording)
        require_placeable(problem)
        self._landmark = problem.landmark.tolist()
        if not SENSORS[recording.sensor].places_landmarks:
            polar, polar_cov = recording.observation, recording.observation_cov
        else:
            polar, polar_cov = as_range_bearing(recording)
        self._step = recording.observation_step.tolist()
        self._polar = polar.tolist()
        self._odometry = recording.odometry.tolist()
        prior_cov = prior_cov_in_body(recording)
        largest = np.sqrt(max(recording.odometry_cov[:1].max(initial=0.0), prior_cov.max()))
        self._prior = gtsam.PriorFactorPose2(
            X(0), gtsam.Pose2(*recording.prior_mean), _noise_model(prior_cov, regularising * largest)
        )
        self._odometry_noise = noise_models(recording.odometry_cov, regularising)
        # GTSAM's order is bearing, then range
        self._observation_noise = noise_models(polar_cov[:, ::-1, ::-1].copy())
        self._bounds = np.searchsorted(recording.observation_step, np.arange(recording.steps + 2)).tolist()

    def motion_factor(self, k: int) -> gtsam.NonlinearFactor:
        """Return the prior (k = 0) or the odometry factor between poses k-1 and k."""
        if k == 0:
            return self._prior
        increment = gtsam.Pose2(*self._odometry[k - 1])
        return gtsam.BetweenFactorPose2(X(k - 1), X(k), increment, self._odometry_noise(k - 1))

    def observations(self, k: int) -> list[tuple[int, int]]:
        """Return landmark id and row of each observation made at pose k."""
        return [(self._landmark[row], row) for row in range(self._bounds[k], self._bounds[k + 1])]

    def observation_factor(self, row: int) -> gtsam.NonlinearFactor:
        """Return the factor of the observation in `row`."""
        pose, landmark = X(self._step[row]), L(self._landmark[row])
        polar, noise = self._polar[row], self._observation_noise(row)
        if len(polar) == 1:
            return gtsam.BearingFactor2D(pose, landmark, gtsam.Rot2(*polar), noise)
        return gtsam.BearingRangeFactor2D(pose, landmark, gtsam.Rot2(polar[1]), polar[0], noise)


class IncrementalGraph:
    """Factors and initial values that each step of a recording adds, for GTSAM's incremental solvers.

    A landmark is added with its first observation. A bearing-only landmark is added later, with all its bearings, as
    soon as they place it (`triangulation`).

    Args:
        recording: known association.
        regularising: as for `GraphBuilder`.

    Attributes:
        mapped: ids of the landmarks in the graph.
        used: (M,) True for observations in the graph.
    """

    def __init__(self, recording: Recording, regularising: float = REGULARISING_NOISE) -> None:
        self._recording = recording
        self._builder = GraphBuilder(recording, regularising)
        self._waiting: dict[int, list[int]] = {}  # rows by id, for landmarks that their bearings do not place yet
        self.mapped: set[int] = set()
        self.used = np.zeros(len(recording.observation), dtype=np.bool_)

    def add_step(self, k: int, path: Float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Return the factors of step k, and initial values of X(k) and of new landmarks from `path` (k+1, 3)."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(self._builder.motion_factor(k))
        values.insert(X(k), gtsam.Pose2(*path[k]))
        places_landmarks = SENSORS[self._recording.sensor].places_landmarks
        for name, row in self._builder.observations(k):
            if name not in self.mapped and places_landmarks:
                self._add_landmark(name, positions_seen(self._recording, np.array([row]), path)[0], values)
            if name in self.mapped:
                self._add_observation(row, graph)
            else:
                self._waiting.setdefault(name, []).append(row)
        return graph, values

    def waiting(self, k: int, oldest: int = 0) -> dict[int, Int]:
        """Return the rows of the bearings of each waiting landmark that is observed at step k, by id.

        Bearings of steps before `oldest` are dropped.
        """
        steps, waiting = self._recording.observation_step, dict[int, Int]()
        for name in sorted({name for name, _ in self._builder.observations(k)} & self._waiting.keys()):
            rows = self._waiting[name] = [row for row in self._waiting[name] if steps[row] >= oldest]
            waiting[name] = np.array(rows)
        return waiting

    def add_waiting(self, waiting: dict[int, Int], path: Float) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Return factors and initial values of waiting landmarks that their bearings from `path` (k+1, 3) place."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for name, rows in waiting.items():
            landmark, sigma = triangulate_one(self._recording, rows, path)
            if np.isfinite(sigma):
                self._add_landmark(name, landmark, values)
                for row in self._waiting.pop(name):
                    self._add_observation(row, graph)
        return graph, values

    def _add_landmark(self, name: int, landmark: Float, values: gtsam.Values) -> None:
        self.mapped.add(name)
        values.insert(L(name), gtsam.Point2(*landmark))

    def _add_observation(self, row: int, graph: gtsam.NonlinearFactorGraph) -> None:
        graph.add(self._builder.observation_factor(row))
        self.used[row] = True


def build_graph(recording: Recording, regularising: float = 0.0) -> gtsam.NonlinearFactorGraph:
    """Return the graph of the whole recording; arguments and errors as `GraphBuilder`."""
    builder = GraphBuilder(recording, regularising)
    graph = gtsam.NonlinearFactorGraph()
    for k in range(recording.steps + 1):
        graph.add(builder.motion_factor(k))
        for _, row in builder.observations(k):
            graph.add(builder.observation_factor(row))
    return graph


def make_values(poses: Float, landmark_ids: Int, landmarks: Float) -> gtsam.Values:
    """Return poses (N+1, 3) and landmarks (L, 2) as GTSAM's values."""
    values = gtsam.Values()
    for k, pose in enumerate(poses.tolist()):
        values.insert(X(k), gtsam.Pose2(*pose))
    for name, landmark in zip(landmark_ids.tolist(), landmarks.tolist(), strict=True):
        values.insert(L(name), gtsam.Point2(*landmark))
    return values


def read_values(values: gtsam.Values) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2) in increasing id order."""
    return gtsam.utilities.extractPose2(values), gtsam.utilities.extractPoint2(values).reshape(-1, 2)


def pose_array(pose: gtsam.Pose2) -> Float:
    """Return a pose as (x, y, heading), (3,)."""
    return np.array([pose.x(), pose.y(), pose.theta()])


def covariance_in_world(heading: float, covariance: Float) -> Float:
    """Return the covariance (3, 3) of the additive pose error in the world frame, T C T' with T = blkdiag(R, 1).

    GTSAM's `covariance` C is in the frame of the pose; R is its rotation by `heading`.
    """
    turn = np.eye(3)
    turn[:2, :2] = rotation(heading)
    return turn @ covariance @ turn.T


def noise_models(covariances: Float, regularising: float = 0.0) -> Callable[[int], gtsam.noiseModel.Base]:
    """Return a function from row to noise model of `covariances` (n, d, d); equal covariances share one model.

    A standard deviation of zero becomes a constraint, or `regularising` times the largest one of its row.
    """
    models: dict[bytes, gtsam.noiseModel.Base] = {}

    def model(row: int) -> gtsam.noiseModel.Base:
        key = covariances[row].tobytes()
        if key not in models:
            models[key] = _noise_model(covariances[row], regularising * np.sqrt(covariances[row].max()))
        return models[key]

    return model


def _noise_model(covariance: Float, minimum_sigma: float) -> gtsam.noiseModel.Base:
    """Return the noise model of a covariance (d, d) whose standard deviations are raised to `minimum_sigma`."""
    sigmas = np.sqrt(np.diag(covariance))
    correlated = np.abs(covariance) > 1e-12 * np.outer(sigmas, sigmas)  # smaller entries are rounding of a rotation
    if not (correlated & ~np.eye(len(covariance), dtype=bool)).any():
        return gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sigmas, minimum_sigma))
    scale = np.where(sigmas > 0, sigmas, 1.0)
    if np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] < 1e-12:
        variances, axes = np.linalg.eigh(covariance)
        covariance = axes * np.maximum(variances, minimum_sigma**2) @ axes.T
    # smart=False: GTSAM's smart mode drops correlations of covariances below 1e-9
    return gtsam.noiseModel.Gaussian.Covariance(covariance, False)
