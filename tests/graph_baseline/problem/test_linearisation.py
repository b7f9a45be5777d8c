"""The linear model of the optimum compared with central differences of its residuals."""

from __future__ import annotations

import math

import gtsam
import numpy as np
import pytest
from numba import njit

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem import linearisation
from slamgauge.graph_baseline.problem.linearisation import LinearModel, inverse_cholesky
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.se2 import between, compose, log, rotation, wrap
from tests.reference.jacobians import differentiate
from tests.reference.random_recordings import recording_of

PI = math.pi
TURNS = [0.0, 1e-12, -1e-7, 5e-5, 0.99e-4, 1.01e-4, -3e-4, 1e-2, 0.7, -2.0, 3.0, PI - 1e-6, -PI + 1e-6, PI - 1e-12]
PLACES = [[0.0, 0.0], [0.3, -0.1], [-40.0, 25.0]]
ANGLES = [0.0, 1e-300, 1e-9, 1e-3, 0.0499, 0.0501, 0.7, 1.6, 3.0, PI]
CASES = pytest.mark.parametrize("far", [False, True])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])


@pytest.mark.parametrize("turn", [*TURNS, PI])
@pytest.mark.parametrize("place", PLACES)
def test_logarithm_equals_gtsams(place: list[float], turn: float) -> None:
    """GTSAM 4.3 has relative errors of 4.6e-10 at -1e-7 rad and 1e-12 at 1e-4 rad, and rounding above 0.1 rad."""
    expected = gtsam.Pose2.Logmap(gtsam.Pose2(place[0], place[1], turn))
    tolerance = 5e-10 if abs(turn) < 1e-5 else 2e-12 if abs(turn) < 0.1 else 1e-14
    distance = 1 + math.hypot(*place)
    np.testing.assert_allclose(log([*place, turn]), expected, rtol=0, atol=tolerance * distance)


@njit
def angle_of(along: float, across: float) -> float:
    return linearisation.angle_of(along, across)


@pytest.mark.parametrize("angle", [*ANGLES, *(-angle for angle in ANGLES)])
@pytest.mark.parametrize("length", [1e-3, 1.0, 1e6])
def test_angle_of_a_vector(angle: float, length: float) -> None:
    along, across = length * math.cos(angle), length * math.sin(angle)
    assert angle_of(along, across) == pytest.approx(math.atan2(across, along), rel=4e-16, abs=0)


def linearised(sensor: str, *, far: bool) -> tuple[Problem, Float, Float, LinearModel]:
    """Return a problem, poses and landmarks away from its optimum, and the model linearised there.

    Args:
        sensor: kind of observations.
        far: headings cover the whole circle, and residuals reach almost half a turn.
    """
    problem, rng = prepare(recording_of(sensor, int(far), steps=12, landmarks=4)), np.random.default_rng(0)
    sigmas = [2.0, 2.0, 2.5] if far else [0.05, 0.05, 0.02]
    poses = compose(problem.dead_reckoning, rng.uniform(-1, 1, (13, 3)) * sigmas)
    if far:  # both sides of the cut at pi
        poses[3, 2], poses[4, 2], poses[5, 2] = PI, -PI + 1e-12, PI - 1e-12
    landmarks = rng.uniform(-6, 6, (len(problem.landmark_ids), 2))
    return problem, poses, landmarks, Objective(problem).at(poses, landmarks).model


@SENSORS
@CASES
def test_start(sensor: str, far: bool) -> None:
    """Residual Log(mean^-1 x_0): mean and covariance of the additive error of x_0."""
    problem, poses, _, model = linearised(sensor, far=far)

    def residual(pose: Float) -> Float:
        return log(between(problem.prior_mean, pose))

    root = np.linalg.inv(differentiate(residual, poses[0], angles=[2]))
    np.testing.assert_allclose(model.c[0], -root @ residual(poses[0]), rtol=1e-9, atol=1e-9)
    turn = np.eye(3)
    turn[:2, :2] = rotation(problem.prior_mean[2])
    in_body = turn.T @ problem.prior_cov @ turn
    np.testing.assert_allclose(model.W[0], root @ in_body @ root.T, rtol=1e-8, atol=1e-11)


@SENSORS
@CASES
def test_motion(sensor: str, far: bool) -> None:
    """With r(x, x') = Log(u^-1 between(x, x')): F = -r_x'^-1 r_x, c = -r_x'^-1 r, W = r_x'^-1 Q r_x'^-T."""
    problem, poses, _, model = linearised(sensor, far=far)
    for k in range(problem.steps):

        def residual(pair: Float, k: int = k) -> Float:
            return log(between(problem.odometry[k], between(pair[:3], pair[3:])))

        pair = np.concatenate([poses[k], poses[k + 1]])
        jacobian = differentiate(residual, pair, angles=[2])
        root, F = np.linalg.inv(jacobian[:, 3:]), np.eye(3)
        F[:2, 2] = model.lever[k + 1]
        scale = max(1.0, float(np.abs(poses[k + 1] - poses[k])[:2].max()))
        np.testing.assert_allclose(F, -root @ jacobian[:, :3], rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(model.c[k + 1], -root @ residual(pair), rtol=0, atol=1e-8 * scale)
        W = root @ problem.odometry_cov[k] @ root.T
        np.testing.assert_allclose(model.W[k + 1], W, rtol=0, atol=1e-8 * np.abs(W).max())


@SENSORS
@CASES
def test_observations(sensor: str, far: bool) -> None:
    """Residual h(x, l) - z, whitened so that its covariance is the identity."""
    problem, poses, landmarks, model = linearised(sensor, far=far)
    assert len(problem.slot) > 10
    whiteners = inverse_cholesky(problem.observation_cov)
    for i, k in enumerate(problem.observation_step):

        def residual(both: Float, i: int = i) -> Float:
            z, delta = problem.observation[i], rotation(both[2]).T @ (both[3:] - both[:2])
            if sensor == "position":
                return delta - z
            off = float(wrap(np.arctan2(delta[1], delta[0]) - z[-1]))
            return np.array([np.hypot(*delta) - z[0], off] if sensor == "range-bearing" else [off])

        both, L = np.concatenate([poses[k], landmarks[problem.slot[i]]]), whiteners[i]
        distance = float(np.hypot(*(both[3:] - both[:2])))
        step = [1e-3 * distance, 1e-3 * distance, 1e-3, 1e-3 * distance, 1e-3 * distance]
        jacobian = differentiate(residual, both, step, angles=[] if sensor == "position" else [len(L) - 1])
        np.testing.assert_allclose(L @ problem.observation_cov[i] @ L.T, np.eye(len(L)), atol=1e-12)
        H = np.column_stack([model.Hx[i], model.Hm[i]])
        np.testing.assert_allclose(L @ jacobian, H, rtol=0, atol=1e-8 * np.abs(H).max())
        np.testing.assert_allclose(model.r[i], L @ residual(both), rtol=1e-12, atol=1e-12 * np.abs(L).max())
