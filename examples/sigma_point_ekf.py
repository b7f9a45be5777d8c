"""Unscented Kalman filter for SLAM as an online class: sigma points replace all Jacobians.

Robot and observed landmark, with their noise, are spread into 2n + 1 points; the motion and the sensor move the points,
and their weighted mean and covariance are the result. Other landmarks change through their correlation. Sources: Julier
and Uhlmann, "Unscented filtering and nonlinear estimation", Proceedings of the IEEE 92(3), 2004; Martinez-Cantin and
Castellanos, "Unscented SLAM for large-scale outdoor environments", IROS 2005.

    slamgauge run q1-short-dense --estimators ekf,mine=examples/sigma_point_ekf.py:SigmaPointEkf
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import block_diag

from slamgauge import sensors
from slamgauge.arrays import Float
from slamgauge.recording import Observations
from slamgauge.se2 import compose, rotation, wrap

CENTRE = 1.0 / 3.0  # weight of the mean


class SigmaPointEkf:
    """Sigma-point SLAM for known landmarks with ranges and bearings, from a start pose (3,) with covariance (3, 3)."""

    def __init__(self, prior_mean: Float, prior_cov: Float) -> None:
        self.ids: list[int] = []
        self.x, self.P = np.array(prior_mean, dtype=np.float64), np.array(prior_cov, dtype=np.float64)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self.x[:3]

    @property
    def pose_cov(self) -> Float:
        """(3, 3) its covariance."""
        return self.P[:3, :3]

    @property
    def landmark_ids(self) -> list[int]:
        """L ids of the landmarks."""
        return self.ids

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self.x[3:].reshape(-1, 2)

    def predict(self, increment: Float, cov: Float) -> None:
        """Move by a body-frame increment (3,) with covariance (3, 3)."""
        mean, own, slope = spread(
            lambda points: compose(points[:, :3], points[:, 3:]),
            np.concatenate([self.x[:3], increment]),
            block_diag(self.P[:3, :3], cov),
            angle=2,
        )
        self.x[:3] = mean
        self.P[:3, 3:] = slope[:, :3] @ self.P[:3, 3:]
        self.P[3:, :3] = self.P[:3, 3:].T
        self.P[:3, :3] = own

    def update(self, observations: Observations) -> None:
        """Correct with the observations of mapped landmarks, then map the others."""
        if observations.landmark is None:
            raise ValueError("this filter needs landmark ids")
        for landmark, z, R in zip(observations.landmark.tolist(), observations.value, observations.cov, strict=True):
            if landmark in self.ids:
                self.correct(3 + 2 * self.ids.index(landmark), z, R)
            else:
                self.add(landmark, z, R)

    def correct(self, at: int, z: Float, R: Float) -> None:
        """Kalman update with one observation z (2,) of the landmark at entry `at`."""
        used = np.array([0, 1, 2, at, at + 1])
        mean, S, slope = spread(seen, self.x[used], self.P[np.ix_(used, used)], angle=1)
        gain = self.P[:, used] @ slope.T @ np.linalg.inv(S + R)
        self.x = self.x + gain @ sensors.innovation("range-bearing", z, mean)
        self.x[2] = wrap(self.x[2])
        self.P = self.P - gain @ (S + R) @ gain.T

    def add(self, landmark: int, z: Float, R: Float) -> None:
        """Append a new landmark, observed at z (2,)."""
        mean, own, slope = spread(placed, np.concatenate([self.x[:3], z]), block_diag(self.P[:3, :3], R))
        across = slope[:, :3] @ self.P[:3]
        self.x, self.P = np.concatenate([self.x, mean]), np.block([[self.P, across.T], [across, own]])
        self.ids.append(landmark)


def spread(
    function: Callable[[Float], Float], mean: Float, cov: Float, angle: int | None = None
) -> tuple[Float, Float, Float]:
    """Return mean (m,) and covariance (m, m) of a function of a Gaussian (n,), and its regression slope (m, n)."""
    n, (values, axes) = len(mean), np.linalg.eigh(cov)
    root = axes * np.sqrt(np.maximum(values, 0.0))  # zero variances are legal
    offsets = np.sqrt(n / (1.0 - CENTRE)) * np.vstack([np.zeros(n), root.T, -root.T])
    weights = np.full(2 * n + 1, (1.0 - CENTRE) / (2 * n))
    weights[0] = CENTRE
    points = function(mean + offsets)
    change = points - points[0]
    if angle is not None:
        change[:, angle] = wrap(change[:, angle])
    shift = weights @ change
    change -= shift
    cross = (weights * change.T) @ offsets
    return points[0] + shift, (weights * change.T) @ change, cross @ np.linalg.pinv(cov, hermitian=True)


def seen(points: Float) -> Float:
    """Return the observations (k, 2) for robot and landmark (k, 5)."""
    delta = [rotation(each[2]).T @ (each[3:] - each[:2]) for each in points]
    return sensors.predict("range-bearing", np.array(delta))


def placed(points: Float) -> Float:
    """Return the landmarks (k, 2) for robot and observation (k, 5)."""
    return np.array([each[:2] + rotation(each[2]) @ sensors.inverse("range-bearing", each[3:]) for each in points])
