"""Robocentric EKF-SLAM as an online class: the map is in the robot's frame, and the world's frame is part of the state.

The state is the origin of the world and its direction [x, y, angle], seen from the robot, and the landmarks, seen from
the robot. An observation then depends on its landmark alone, with the Jacobian of the sensor, and the robot's motion is
a change of frame that all entries share. Source: Castellanos, Martinez-Cantin, Tardos and Neira, "Robocentric map
joining: Improving the consistency of EKF-SLAM", Robotics and Autonomous Systems 55(1), 2007.

    slamgauge run q1-short-dense --estimators ekf,mine=examples/robocentric_ekf.py:RobocentricEkf
"""

from __future__ import annotations

import numpy as np

from slamgauge import sensors
from slamgauge.arrays import Float
from slamgauge.recording import Observations
from slamgauge.se2 import rotation, wrap

J = np.array([[0.0, -1.0], [1.0, 0.0]])


class RobocentricEkf:
    """EKF-SLAM in the robot's frame, for known landmarks with ranges and bearings.

    Args:
        prior_mean: (3,) start pose x, y [m], heading [rad] in the world frame.
        prior_cov: (3, 3) its covariance.
    """

    def __init__(self, prior_mean: Float, prior_cov: Float) -> None:
        self.ids: list[int] = []
        self.x, jacobian = inverse(np.asarray(prior_mean, dtype=np.float64))
        self.P = jacobian @ prior_cov @ jacobian.T

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return inverse(self.x[:3])[0]

    @property
    def pose_cov(self) -> Float:
        """(3, 3) its covariance."""
        jacobian = inverse(self.x[:3])[1]
        return jacobian @ self.P[:3, :3] @ jacobian.T

    @property
    def landmark_ids(self) -> list[int]:
        """L ids of the landmarks."""
        return self.ids

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return (self.x[3:].reshape(-1, 2) - self.x[:2]) @ rotation(self.x[2])

    def predict(self, increment: Float, cov: Float) -> None:
        """Move by a body-frame increment (3,) with covariance (3, 3): everything is then seen from the new frame."""
        turn = rotation(increment[2]).T
        n = len(self.x)
        F, G = np.zeros((n, n)), np.zeros((n, 3))
        F[2, 2], G[2, 2] = 1.0, -1.0
        for i in (0, *range(3, n, 2)):
            moved = turn @ (self.x[i : i + 2] - increment[:2])
            F[i : i + 2, i : i + 2], G[i : i + 2, :2] = turn, -turn
            G[i : i + 2, 2] = -J @ moved
            self.x[i : i + 2] = moved
        self.x[2] = wrap(self.x[2] - increment[2])
        self.P = F @ self.P @ F.T + G @ cov @ G.T

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
        H = np.zeros((2, len(self.x)))
        H[:, at : at + 2] = sensors.jacobian("range-bearing", self.x[at : at + 2])
        innovation = sensors.innovation("range-bearing", z, sensors.predict("range-bearing", self.x[at : at + 2]))
        gain = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        self.x = self.x + gain @ innovation
        self.x[2] = wrap(self.x[2])
        self.P = self.P - gain @ H @ self.P

    def add(self, landmark: int, z: Float, R: Float) -> None:
        """Append a new landmark: in the robot's frame it is independent of everything else."""
        n, jacobian = len(self.x), sensors.inverse_jacobian("range-bearing", z)
        self.x = np.concatenate([self.x, sensors.inverse("range-bearing", z)])
        P = np.zeros((n + 2, n + 2))
        P[:n, :n], P[n:, n:] = self.P, jacobian @ R @ jacobian.T
        self.P = P
        self.ids.append(landmark)


def inverse(pose: Float) -> tuple[Float, Float]:
    """Return the inverse of a pose (3,), and its Jacobian (3, 3)."""
    turn = rotation(pose[2]).T
    place = -turn @ pose[:2]
    jacobian = -np.eye(3)
    jacobian[:2, :2], jacobian[:2, 2] = -turn, -J @ place
    return np.array([*place, wrap(-pose[2])]), jacobian
