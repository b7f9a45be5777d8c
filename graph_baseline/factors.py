"""The recording as a GTSAM factor graph: built-in factors, poses X(k) and landmarks L(id).

The `position` sensor has no planar built-in factor. Its observations enter as range and bearing, with
the covariance carried over at the measured point; `smoother` then finishes on the exact model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Concatenate, ParamSpec

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int, Marks
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.triangulation import triangulate_all
from slamgauge.graph_baseline.undetermined import undetermined_variable
from slamgauge.recording import Recording
from slamgauge.se2 import chain, compose, rotation

# Lent to a motion direction of zero variance, as a share of the largest standard deviation of its step
# (0.1 mm beside the practical's 30 mm), where GTSAM's solvers would stumble over a hard constraint.
LENT_SLIP = 1.0 / 300.0

Rest = ParamSpec("Rest")

NEAREST = 1e-6  # m: a landmark at the sensor itself has no bearing
MAX_LANDMARK_SIGMA = 3e5  # m; what is known less well drowns in the rounding of what is known to a millimetre


def require_known_landmarks(recording: Recording) -> Int:
    """The landmark ids of a recording that a graph can be built from.

    Raises:
        UserError: unknown association.
    """
    if recording.landmark is None:
        raise UserError("landmark: the graph needs known association; give ids, or run it under a filter's: batch@ekf")
    return recording.landmark


def as_range_bearing(recording: Recording) -> tuple[Float, Float]:
    """Observations (M, 2) as range [m] and bearing [rad], and their covariances (M, 2, 2)."""
    if recording.sensor == "range-bearing":
        return recording.observation, recording.observation_cov
    x, y = recording.observation.T
    x = np.where(np.hypot(x, y) < NEAREST, NEAREST, x)
    distance = np.hypot(x, y)
    jacobian = np.stack([np.stack([x, y], -1) / distance[:, None], np.stack([-y, x], -1) / distance[:, None] ** 2], 1)
    polar = np.column_stack([distance, np.arctan2(y, x)])
    return polar, jacobian @ recording.observation_cov @ jacobian.swapaxes(1, 2)


def prior_cov_in_body(recording: Recording) -> Float:
    """The prior's covariance (3, 3) in the body frame of its mean, where GTSAM expects it."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(recording.prior_mean[2])
    return turn.T @ recording.prior_cov @ turn


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
        if recording.sensor == "bearing":
            polar, polar_cov = recording.observation, recording.observation_cov
        else:
            polar, polar_cov = as_range_bearing(recording)
            landmark, sigma = least_known_landmark(recording)
            if sigma > MAX_LANDMARK_SIGMA:
                raise undetermined_variable("l", landmark)
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


def least_known_landmark(recording: Recording) -> tuple[int, float]:
    """The landmark that its sights, from the dead-reckoned path, place worst, and its largest sigma [m].

    (-1, 0.0) for a recording without observations.
    """
    if recording.sensor == "bearing":
        ids, _, sigmas = triangulate_all(recording, chain(recording.prior_mean, recording.odometry))
        worst = int(np.argmax(sigmas)) if len(ids) else -1
        return (int(ids[worst]), float(sigmas[worst])) if len(ids) else (-1, 0.0)
    polar, polar_cov = as_range_bearing(recording)
    if len(polar) == 0:
        return -1, 0.0
    path = chain(recording.prior_mean, recording.odometry)
    H = rotation(path[recording.observation_step, 2] + polar[:, 1]).swapaxes(1, 2)  # along the ray, and across it
    H[:, 1] /= np.maximum(polar[:, :1], 1e-6)
    landmark_ids, slot = np.unique(require_known_landmarks(recording), return_inverse=True)
    information = np.zeros((len(landmark_ids), 2, 2))
    np.add.at(information, slot, H.swapaxes(1, 2) @ np.linalg.inv(polar_cov) @ H)
    weakest = np.linalg.eigvalsh(information)[:, 0]
    worst = int(np.argmin(weakest))
    return int(landmark_ids[worst]), float(1.0 / np.sqrt(max(weakest[worst], 1e-300)))


def are_placed(recording: Recording, path: Float) -> Marks:
    """Which observations (M,) are of landmarks that can be placed; with ranges all are.

    Bearings alone, taken from a path (N+1, 3), may not place a landmark: one seen once, or without parallax, tells
    next to nothing about the path.
    """
    if recording.sensor != "bearing":
        return np.ones(len(recording.observation), dtype=bool)
    ids, _, sigmas = triangulate_all(recording, path)
    return np.isin(require_known_landmarks(recording), ids[np.isfinite(sigmas)])


def are_seen_again(recording: Recording) -> Marks:
    """Which observations (M,) are of landmarks that several poses have seen."""
    _, slot = np.unique(require_known_landmarks(recording), return_inverse=True)
    sights = np.unique(np.column_stack([slot, recording.observation_step]), axis=0)
    return np.bincount(sights[:, 0])[slot] > 1


def among_mapped(estimate: Estimate, association: Int) -> Estimate:
    """The estimate for an association (M,) of its own; -1 for what was given to landmarks that are not mapped."""
    mapped = np.isin(association, np.asarray(estimate.landmark_ids))
    return replace(estimate, association=np.where(mapped, association, -1))


def relative_to_start(
    estimator: Callable[Concatenate[Recording, Rest], Estimate],
) -> Callable[Concatenate[Recording, Rest], Estimate]:
    """The same estimator, computing in the frame of the start: no digits are lost far away, nor depend on a heading."""

    @wraps(estimator)
    def relative(recording: Recording, /, *rest: Rest.args, **named: Rest.kwargs) -> Estimate:
        start = recording.prior_mean
        if not start.any():
            return estimator(recording, *rest, **named)
        here = replace(recording, prior_mean=np.zeros(3), prior_cov=prior_cov_in_body(recording))
        found = estimator(here, *rest, **named)
        turn = np.eye(3)
        turn[:2, :2] = rotation(start[2])
        assert found.pose_covs is not None and found.landmark_covs is not None
        return replace(
            found,
            poses=compose(start, found.poses),
            pose_covs=turn @ found.pose_covs @ turn.T,
            landmarks=start[:2] + found.landmarks @ turn[:2, :2].T,
            landmark_covs=turn[:2, :2] @ found.landmark_covs @ turn[:2, :2].T,
        )

    return relative


def first_sights(recording: Recording) -> tuple[Int, Int]:
    """Ids of the landmarks in increasing order, and the row of each one's first observation."""
    return np.unique(require_known_landmarks(recording), return_index=True)


def landmarks_at_first_sight(recording: Recording, poses: Float) -> Float:
    """Landmarks (L, 2), in the order of `first_sights`, where their first sights from `poses` put them."""
    if recording.sensor == "bearing":
        return triangulate_all(recording, poses)[1]
    rows = first_sights(recording)[1]
    seen_from = poses[recording.observation_step[rows]]
    polar = as_range_bearing(recording)[0][rows]
    angle = seen_from[:, 2] + polar[:, 1]
    return seen_from[:, :2] + polar[:, :1] * np.column_stack([np.cos(angle), np.sin(angle)])


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
