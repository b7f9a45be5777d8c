"""The recording as a GTSAM factor graph, and GTSAM's searches on it: all that needs GTSAM, which not every system has.

Built-in factors, poses X(k) and landmarks L(id). The `position` sensor has no planar built-in factor. Its observations
enter as range and bearing, with the covariance carried over at the measured point; `smoother` then finishes on the
exact model.
"""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int, Marks
from slamgauge.graph_baseline.problem.preparation import (
    as_range_bearing,
    first_sights,
    prior_cov_in_body,
    require_known_landmarks,
    require_placeable,
)
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

# Lent to a motion direction of zero variance, as a share of the largest standard deviation of its step
# (0.1 mm beside the practical's 30 mm), where GTSAM's solvers would stumble over a hard constraint.
LENT_SLIP = 1.0 / 300.0


def noise_models(covariances: Float, lent: float = 0.0) -> Callable[[int], gtsam.noiseModel.Base]:
    """Noise model of each row of `covariances` (n, d, d); equal covariances share one model.

    A variance of exactly 0 becomes a constraint, or is `lent` a share of the row's largest standard deviation.
    """
    models: dict[bytes, gtsam.noiseModel.Base] = {}

    def model(row: int) -> gtsam.noiseModel.Base:
        key = covariances[row].tobytes()
        if key not in models:
            models[key] = _noise_model(covariances[row], lent * np.sqrt(covariances[row].max()))
        return models[key]

    return model


def _noise_model(covariance: Float, minimum_sigma: float) -> gtsam.noiseModel.Base:
    sigmas = np.sqrt(np.diag(covariance))
    correlated = np.abs(covariance) > 1e-12 * np.outer(sigmas, sigmas)  # more than a turned frame's rounding
    if not (correlated & ~np.eye(len(covariance), dtype=bool)).any():
        return gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sigmas, minimum_sigma))
    scale = np.where(sigmas > 0, sigmas, 1.0)
    if np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] < 1e-12:
        variances, axes = np.linalg.eigh(covariance)
        covariance = axes * np.maximum(variances, minimum_sigma**2) @ axes.T
    # not smart: GTSAM would take correlations for rounding where covariances are below 1e-9
    return gtsam.noiseModel.Gaussian.Covariance(covariance, False)


class GraphBuilder:
    """Factors of a recording, step by step.

    Args:
        recording: known association; of bearings alone, landmarks that they place (see `are_placed`).
        lent: share of a step's largest standard deviation that its directions of zero variance are lent
            (those of the start: of its own or the first step's); 0 keeps them as hard constraints.

    Raises:
        UserError: the recording cannot be turned into a graph; says why and what to do.
    """

    def __init__(self, recording: Recording, lent: float = 0.0) -> None:
        self._landmark = require_known_landmarks(recording).tolist()
        require_placeable(recording)
        if not SENSORS[recording.sensor].places_landmarks:
            polar, polar_cov = recording.observation, recording.observation_cov
        else:
            polar, polar_cov = as_range_bearing(recording)
        self._polar = polar.tolist()
        self._odometry = recording.odometry.tolist()
        prior_cov = prior_cov_in_body(recording)
        largest = np.sqrt(max(recording.odometry_cov[:1].max(initial=0.0), prior_cov.max()))
        self._prior = gtsam.PriorFactorPose2(
            X(0), gtsam.Pose2(*recording.prior_mean), _noise_model(prior_cov, lent * largest)
        )
        self._motion_noise = noise_models(recording.odometry_cov, lent)
        # GTSAM's order is bearing, range
        self._sensor_noise = noise_models(polar_cov[:, ::-1, ::-1].copy())
        self._bounds = np.searchsorted(recording.observation_step, np.arange(recording.steps + 2)).tolist()

    def increment(self, k: int) -> gtsam.Pose2:
        """The measured motion that leads to pose k > 0."""
        return gtsam.Pose2(*self._odometry[k - 1])

    def sights(self, k: int) -> list[tuple[int, int]]:
        """What is seen from pose k: landmark ids and rows of the observations."""
        rows = range(self._bounds[k], self._bounds[k + 1])
        return [(self._landmark[row], row) for row in rows]

    def add_motion(self, graph: gtsam.NonlinearFactorGraph, k: int) -> None:
        """Append the prior (k = 0) or the increment that leads to pose k."""
        if k == 0:
            graph.add(self._prior)
        else:
            graph.add(gtsam.BetweenFactorPose2(X(k - 1), X(k), self.increment(k), self._motion_noise(k - 1)))

    def sight_factor(self, k: int, row: int) -> gtsam.NonlinearFactor:
        """The factor of an observation from pose k."""
        keys, sight, noise = (X(k), L(self._landmark[row])), self._polar[row], self._sensor_noise(row)
        if len(sight) == 1:
            return gtsam.BearingFactor2D(*keys, gtsam.Rot2(*sight), noise)
        return gtsam.BearingRangeFactor2D(*keys, gtsam.Rot2(sight[1]), sight[0], noise)


def build_graph(recording: Recording, lent: float = 0.0) -> gtsam.NonlinearFactorGraph:
    """The whole recording as a graph; see `GraphBuilder`."""
    builder = GraphBuilder(recording, lent)
    graph = gtsam.NonlinearFactorGraph()
    for k in range(recording.steps + 1):
        builder.add_motion(graph, k)
        for _, row in builder.sights(k):
            graph.add(builder.sight_factor(k, row))
    return graph


def make_values(poses: Float, landmark_ids: Int, landmarks: Float) -> gtsam.Values:
    """GTSAM's form of poses (N+1, 3) and landmarks (L, 2)."""
    values = gtsam.Values()
    for k, pose in enumerate(poses.tolist()):
        values.insert(X(k), gtsam.Pose2(*pose))
    for name, landmark in zip(landmark_ids.tolist(), landmarks.tolist(), strict=True):
        values.insert(L(name), gtsam.Point2(*landmark))
    return values


def read_values(values: gtsam.Values) -> tuple[Float, Float]:
    """Poses (N+1, 3) and landmarks (L, 2) in increasing id order."""
    return gtsam.utilities.extractPose2(values), gtsam.utilities.extractPoint2(values).reshape(-1, 2)


def levenberg_marquardt(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, iterations: int = 100) -> gtsam.Values:
    """The minimum that GTSAM's Levenberg-Marquardt reaches from `values`, to be finished by exact steps (`descent`)."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-5)
    parameters.setMaxIterations(iterations)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()


def descended(recording: Recording, poses: Float, landmarks: Float, iterations: int = 100) -> tuple[Float, Float]:
    """Where Levenberg-Marquardt leads from poses (N+1, 3) and landmarks (L, 2) in increasing id order, slip lent."""
    values = make_values(poses, first_sights(recording)[0], landmarks)
    with explained():
        return read_values(levenberg_marquardt(build_graph(recording, LENT_SLIP), values, iterations))


def agreeing(recording: Recording, poses: Float, landmarks: Float, probability: float) -> Marks:
    """Which observations (M,) graduated non-convexity trusts, from a start; true ones with this `probability`."""
    graph = build_graph(recording, LENT_SLIP)
    rows = recording.observation_step + 1 + np.arange(len(recording.observation))  # after each step's motion
    parameters = gtsam.GncLMParams()
    parameters.setLossType(gtsam.GncLossType.TLS)
    parameters.setKnownInliers(np.setdiff1d(np.arange(graph.size()), rows).tolist())
    with explained():
        values = make_values(poses, first_sights(recording)[0], landmarks)
        optimizer = gtsam.GncLMOptimizer(graph, values, parameters)
        optimizer.setInlierCostThresholdsAtProbability(probability)
        optimizer.optimize()
    return np.asarray(optimizer.getWeights())[rows] >= 0.5
