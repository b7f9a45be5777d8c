"""A recording as a GTSAM graph, built factor by factor without the project's code.

The `position` sensor is an exact but slow `CustomFactor`.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.se2 import rotation


def exact_graph(recording: Recording) -> gtsam.NonlinearFactorGraph:
    """Return a graph with poses X(k) and landmarks L(id); variances of zero are constraints."""
    assert recording.landmark is not None
    graph = gtsam.NonlinearFactorGraph()
    start = gtsam.Pose2(*recording.prior_mean.tolist())
    graph.add(gtsam.PriorFactorPose2(X(0), start, noise_model(recording.prior_cov)))
    for k, (increment, cov) in enumerate(zip(recording.odometry.tolist(), recording.odometry_cov, strict=True)):
        graph.add(gtsam.BetweenFactorPose2(X(k), X(k + 1), gtsam.Pose2(*increment), noise_model(cov)))
    sights = zip(recording.observation_step.tolist(), recording.landmark.tolist(), strict=True)
    for (k, name), z, cov in zip(sights, recording.observation, recording.observation_cov, strict=True):
        factor = position_factor if recording.sensor == "position" else polar_factor
        graph.add(factor(k, name, z, cov))
    return graph


def noise_model(cov: Float) -> gtsam.noiseModel.Base:
    variances = np.diag(cov)
    if (variances == 0).any():
        assert np.array_equal(cov, np.diag(variances))
        return gtsam.noiseModel.Constrained.MixedSigmas(np.full(len(cov), 1000.0), np.sqrt(variances))
    return gtsam.noiseModel.Gaussian.Covariance(cov, False)


def polar_factor(step: int, name: int, z: Float, cov: Float) -> gtsam.NonlinearFactor:
    """Return a factor of range and bearing; GTSAM's order of the noise is bearing, range."""
    noise = gtsam.noiseModel.Gaussian.Covariance(cov[::-1, ::-1].copy(), False)
    return gtsam.BearingRangeFactor2D(X(step), L(name), gtsam.Rot2(z[1]), z[0], noise)


def position_factor(step: int, name: int, z: Float, cov: Float) -> gtsam.NonlinearFactor:
    """Return a factor with residual R' (l - p) - z and Jacobians by the body-frame tangent and by the landmark."""

    def residual(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Float] | None) -> Float:
        pose, landmark = values.atPose2(factor.keys()[0]), values.atPoint2(factor.keys()[1])
        to_body = rotation(pose.theta()).T
        delta = to_body @ (landmark - np.array([pose.x(), pose.y()]))
        if jacobians is not None:
            jacobians[0] = np.asfortranarray([[-1.0, 0.0, delta[1]], [0.0, -1.0, -delta[0]]])
            jacobians[1] = np.asfortranarray(to_body)
        return delta - z

    return gtsam.CustomFactor(gtsam.noiseModel.Gaussian.Covariance(cov, False), [X(step), L(name)], residual)


def as_values(poses: Float, ids: Int, landmarks: Float) -> gtsam.Values:
    values = gtsam.Values()
    for k, pose in enumerate(poses.tolist()):
        values.insert(X(k), gtsam.Pose2(*pose))
    for name, landmark in zip(ids.tolist(), landmarks, strict=True):
        values.insert(L(name), landmark)
    return values


def solve_graph(graph: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> Float:
    """Return poses (N+1, 3) of the minimum near `start`, by Gauss-Newton until the cost does not change."""
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(0.0)
    parameters.setAbsoluteErrorTol(1e-13)
    parameters.setLinearSolverType("MULTIFRONTAL_QR")  # the solver that accepts constraints
    return gtsam.utilities.extractPose2(gtsam.GaussNewtonOptimizer(graph, start, parameters).optimize())


def marginals(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, poses: Float, ids: Int) -> tuple[Float, Float]:
    """Return GTSAM's covariances of poses, rotated to additive world coordinates, and of landmarks."""
    found = gtsam.Marginals(graph, values)
    turn = np.tile(np.eye(3), (len(poses), 1, 1))
    turn[:, :2, :2] = rotation(poses[:, 2])
    body = np.array([found.marginalCovariance(X(k)) for k in range(len(poses))])
    own = np.array([found.marginalCovariance(L(name)) for name in ids.tolist()])
    return turn @ body @ turn.swapaxes(1, 2), own
