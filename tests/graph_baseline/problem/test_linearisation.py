"""The linear model of the optimum compared with central differences of its residuals."""

from __future__ import annotations

import math

import gtsam
import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import LinearModel, linearise
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, log, rotation, wrap
from tests.reference.jacobians import differentiate
from tests.reference.random_recordings import random_recording

PI = math.pi
TURNS = [0.0, 1e-12, -1e-7, 5e-5, 0.99e-4, 1.01e-4, -3e-4, 1e-2, 0.7, -2.0, 3.0, PI - 1e-6, -PI + 1e-6, PI - 1e-12]
PLACES = [[0.0, 0.0], [0.3, -0.1], [-40.0, 25.0]]


# --- the logarithm of SE(2) ------------------------------------------------------------------


@pytest.mark.parametrize("turn", [*TURNS, PI])
@pytest.mark.parametrize("place", PLACES)
def test_logarithm_equals_gtsams(place: list[float], turn: float) -> None:
    """GTSAM 4.3 has relative errors of 4.6e-10 at -1e-7 rad and 1e-12 at 1e-4 rad, and rounding above 0.1 rad."""
    expected = gtsam.Pose2.Logmap(gtsam.Pose2(place[0], place[1], turn))
    tolerance = 5e-10 if abs(turn) < 1e-5 else 2e-12 if abs(turn) < 0.1 else 1e-14
    distance = 1 + math.hypot(*place)
    np.testing.assert_allclose(log([*place, turn]), expected, rtol=0, atol=tolerance * distance)


# --- the model -----------------------------------------------------------------------------------


def problem(seed: int, sensor: str, *, far: bool) -> tuple[Recording, Float, Float, Int, LinearModel]:
    """Return a recording, poses and landmarks away from its optimum, their slots, and the model linearised there.

    Args:
        far: headings cover the whole circle, and residuals reach almost half a turn.
    """
    _, recording = random_recording(seed, sensor=sensor, steps=12, landmarks=4)
    rng = np.random.default_rng(seed)
    sigmas = [2.0, 2.0, 2.5] if far else [0.05, 0.05, 0.02]
    poses = chain(recording.prior_mean, recording.odometry)
    poses = compose(poses, rng.uniform(-1, 1, poses.shape) * sigmas)
    if far:  # both sides of the cut at pi
        poses[3, 2], poses[4, 2], poses[5, 2] = PI, -PI + 1e-12, PI - 1e-12
    assert recording.landmark is not None
    slot: Int = np.searchsorted(np.unique(recording.landmark), recording.landmark).astype(np.int64)
    landmarks = rng.uniform(-6, 6, (4, 2))
    return recording, poses, landmarks, slot, linearise(recording, slot, poses, landmarks)


CASES = pytest.mark.parametrize(
    ("seed", "sensor", "far"),
    [(0, "range-bearing", False), (1, "range-bearing", True), (2, "position", False), (3, "position", True)],
)


@CASES
def test_prior(seed: int, sensor: str, far: bool) -> None:
    """Residual Log(mean^-1 x_0): mean and covariance of the additive error of x_0."""
    recording, poses, _, _, model = problem(seed, sensor, far=far)

    def residual(pose: Float) -> Float:
        return log(between(recording.prior_mean, pose))

    root = np.linalg.inv(differentiate(residual, poses[0], angles=[2]))
    np.testing.assert_allclose(model.start, -root @ residual(poses[0]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(model.start_cov, root @ recording.prior_cov @ root.T, rtol=1e-8, atol=1e-11)


@CASES
def test_motion(seed: int, sensor: str, far: bool) -> None:
    """With r(x, x') = Log(u^-1 between(x, x')): F = -r_x'^-1 r_x, c = -r_x'^-1 r, W = r_x'^-1 Q r_x'^-T."""
    recording, poses, _, _, model = problem(seed, sensor, far=far)
    for k in range(recording.steps):

        def residual(pair: Float, k: int = k) -> Float:
            return log(between(recording.odometry[k], between(pair[:3], pair[3:])))

        pair = np.concatenate([poses[k], poses[k + 1]])
        jacobian = differentiate(residual, pair, angles=[2])
        root = np.linalg.inv(jacobian[:, 3:])
        scale = max(1.0, float(np.abs(poses[k + 1] - poses[k])[:2].max()))
        np.testing.assert_allclose(model.F[k], -root @ jacobian[:, :3], rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(model.c[k], -root @ residual(pair), rtol=0, atol=1e-8 * scale)
        W = root @ recording.odometry_cov[k] @ root.T
        np.testing.assert_allclose(model.W[k], W, rtol=0, atol=1e-8 * np.abs(W).max())


@CASES
def test_observations(seed: int, sensor: str, far: bool) -> None:
    """Residual h(x, l) - z, whitened so that its covariance is the identity."""
    recording, poses, landmarks, slot, model = problem(seed, sensor, far=far)
    assert len(slot) > 10
    for i, k in enumerate(recording.observation_step):

        def residual(both: Float, i: int = i) -> Float:
            delta = rotation(both[2]).T @ (both[3:] - both[:2])
            if sensor == "position":
                return delta - recording.observation[i]
            z = recording.observation[i]
            return np.array([np.hypot(*delta) - z[0], float(wrap(np.arctan2(delta[1], delta[0]) - z[1]))])

        both = np.concatenate([poses[k], landmarks[slot[i]]])
        distance = float(np.hypot(*(both[3:] - both[:2])))
        step = [1e-3 * distance, 1e-3 * distance, 1e-3, 1e-3 * distance, 1e-3 * distance]
        jacobian = differentiate(residual, both, step, angles=[1] if sensor == "range-bearing" else [])
        # any square root of the covariance is valid, so the whitened covariance is compared
        H = np.column_stack([model.Hx[i], model.Hm[i]])
        whitener = H @ np.linalg.pinv(jacobian)
        np.testing.assert_allclose(whitener @ recording.observation_cov[i] @ whitener.T, np.eye(2), atol=1e-7)
        np.testing.assert_allclose(whitener @ jacobian, H, rtol=0, atol=1e-8 * np.abs(H).max())
        np.testing.assert_allclose(model.r[i], whitener @ residual(both), rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(model.step, recording.observation_step)
    np.testing.assert_array_equal(model.slot, slot)
