"""A linear graph with the Jacobians of the textbook EKF has the mean and covariance of the EKF.

A Kalman filter solves a linear least-squares problem. Every factor of the graph here has the Jacobian of the textbook
EKF: motions at the filtered pose, observations at the predicted state, and first observations at the position of the
new landmark. One solution for all poses and landmarks gives the newest pose and the landmarks of the EKF.

Unknowns are the noise of the motions, x_k = F x_{k-1} + c + G w_k. Noise without variance has no unknown, so that
motion without lateral noise and a fixed start are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import SlamFilter, ekf_slam
from slamgauge.ekf.textbook import Belief, Linearised, augment, linearise, motion_jacobians, predict, stack, update
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from tests.reference.least_squares import square_root
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

# step, landmark slot, Hx, Hl, constant b and covariance R of 0 = Hx x + Hl l - b + noise
Observed = tuple[int, int, Float, Float, Float, Float]


@dataclass
class FrozenFactors:
    """Affine factors over x_0, w_1, w_2, ... and the landmarks."""

    motions: list[tuple[Float, Float, Float]] = field(default_factory=list)  # F, c, G of each step
    observations: list[Observed] = field(default_factory=list)
    ids: list[int] = field(default_factory=list)


def freeze(recording: Recording) -> FrozenFactors:
    """Run the textbook EKF and collect its linearised factors. Headings of the factors are not wrapped."""
    assert recording.landmark is not None
    frozen = FrozenFactors()
    belief = Belief(recording.prior_mean, recording.prior_cov, ())
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            increment, before = recording.odometry[k - 1], belief.x[:3]
            F, G = motion_jacobians(before, increment)
            belief = predict(belief, increment, recording.odometry_cov[k - 1])
            belief.x[2] = before[2] + increment[2]
            frozen.motions.append((F, belief.x[:3] - F @ before, G))
        assert scan.landmark is not None
        names = scan.landmark.tolist()
        old = [i for i, name in enumerate(names) if name in belief.ids]
        if old:
            slots, heading = np.array([belief.ids.index(names[i]) for i in old]), belief.x[2]
            seen = linearise(recording.sensor, belief.x, slots, scan.value[old], scan.cov[old])
            frozen.observations += frozen_observations(k, slots, belief.x, seen)
            belief, *_ = update(belief, *stack(seen, len(belief.x)))
            belief.x[2] = heading + wrap(belief.x[2] - heading)
        for i, name in enumerate(names):
            if name not in belief.ids:
                belief = augment(recording.sensor, belief, name, scan.value[i], scan.cov[i])
                slot = np.array([len(belief.ids) - 1])
                seen = linearise(recording.sensor, belief.x, slot, scan.value[[i]], scan.cov[[i]])
                np.testing.assert_allclose(seen.innovation, 0.0, atol=1e-12)
                frozen.observations += frozen_observations(k, slot, belief.x, seen)
    frozen.ids += belief.ids
    return frozen


def frozen_observations(step: int, slots: Int, x: Float, seen: Linearised) -> list[Observed]:
    """Return the factors z = h(x^) + H (x - x^) + noise."""
    found: list[Observed] = []
    for slot, v, H, columns, R in zip(slots.tolist(), *seen, strict=True):
        found.append((step, slot, H[:, :3], H[:, 3:], v + H @ x[columns], R))
    return found


def solve(recording: Recording, frozen: FrozenFactors) -> tuple[Float, Float]:
    """Compute mean and covariance of the newest pose and all landmarks by one dense least-squares problem.

    Unknowns: unit-variance coordinates of the start and of every motion's noise, then the landmarks.
    """
    roots = [square_root(recording.prior_cov), *(square_root(Q) for Q in recording.odometry_cov)]
    noises = sum(root.shape[1] for root in roots)
    size = noises + 2 * len(frozen.ids)
    maps, constants = [np.zeros((3, size))], [recording.prior_mean]
    maps[0][:, : roots[0].shape[1]] = roots[0]
    first = roots[0].shape[1]
    for (F, c, G), root in zip(frozen.motions, roots[1:], strict=True):
        pose = F @ maps[-1]
        pose[:, first : first + root.shape[1]] += G @ root
        first += root.shape[1]
        maps.append(pose)
        constants.append(F @ constants[-1] + c)
    rows, right = [np.eye(noises, size)], [np.zeros(noises)]
    for step, slot, Hx, Hl, b, R in frozen.observations:
        row = Hx @ maps[step]
        row[:, noises + 2 * slot : noises + 2 * slot + 2] += Hl
        whitener = np.linalg.inv(np.linalg.cholesky(R))
        rows.append(whitener @ row)
        right.append(whitener @ (b - Hx @ constants[step]))
    q, r = np.linalg.qr(np.vstack(rows))
    newest = np.eye(3 + 2 * len(frozen.ids), size, k=noises - 3)
    newest[:3] = maps[-1]
    spread = np.linalg.solve(r.T, newest.T)
    mean = np.asarray(spread.T @ (q.T @ np.concatenate(right)), dtype=np.float64)
    mean[:3] += constants[-1]
    return mean, spread.T @ spread


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
@pytest.mark.parametrize("start", ["prior", "fixed"])
@pytest.mark.parametrize("seed", range(3))
def test_the_linear_graph_frozen_at_the_filters_jacobians_gives_the_filter(
    seed: int, start: str, slip: bool, sensor: str
) -> None:
    sigmas = (0.1, 0.1, 0.02) if start == "prior" else (0.0, 0.0, 0.0)
    _, recording = random_recording(seed, sensor=sensor, slip=slip, steps=40, prior_sigmas=sigmas)
    if start == "prior":  # correlated, and turned against the axes
        root = np.random.default_rng(seed).normal(size=(3, 3)) * [[0.1], [0.1], [0.02]]
        recording = replace(recording, prior_cov=root @ root.T)
    frozen = freeze(recording)
    mean, cov = solve(recording, frozen)
    sigma = np.sqrt(np.diag(cov))

    estimate = ekf_slam(recording)
    np.testing.assert_array_equal(estimate.landmark_ids, frozen.ids)
    difference = np.concatenate([estimate.poses[-1], estimate.landmarks.ravel()]) - mean
    difference[2] = wrap(difference[2])
    np.testing.assert_allclose(difference / sigma, 0.0, atol=1e-9)

    unit = np.outer(sigma, sigma)
    np.testing.assert_allclose(joint_covariance(recording) / unit, cov / unit, rtol=0, atol=1e-9)
    assert estimate.pose_covs is not None
    np.testing.assert_allclose(estimate.pose_covs[-1] / unit[:3, :3], (cov / unit)[:3, :3], rtol=0, atol=1e-9)


def joint_covariance(recording: Recording) -> Float:
    """Return the covariance of robot and landmarks, from the online form of the same filter."""
    slam = SlamFilter(recording.sensor, recording.prior_mean, recording.prior_cov)
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        if len(scan.value):
            slam.update(scan)
    return slam.cov
