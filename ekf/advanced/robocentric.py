"""The robocentric EKF: the map is estimated in the robot's frame.

Source: Castellanos, Martinez-Cantin, Tardos and Neira, "Robocentric map joining: Improving the consistency of
EKF-SLAM", Robotics and Autonomous Systems 55(1), 2007.

The state contains the last displacement u of the robot, the landmarks f and the world frame w, all in the robot's frame
before that displacement. A step has three parts:

1. The prediction sets u to the odometry increment, with the increment's covariance. The rest is unchanged.
2. The update corrects u, f and w together: the position of a landmark in the robot's new frame is R(u)' (f - u).
3. The composition transforms f and w to the robot's new frame, with Jacobians at the corrected values.

Part 3 runs before the next prediction and before new landmarks are mapped. The robot's pose in the world is at any time
the difference of u and w. No observation depends on w, so observations add no information about the world frame. The
origin of the world frame is the start, so that a shift of the world coordinates changes no computation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.ekf.advanced.dense_algebra import (
    block_diagonal,
    kalman_step,
    pairs,
    place_jacobian,
    symmetric,
    times_rows,
)
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.maps.input_checks import start_of
from slamgauge.se2 import between, rotation
from slamgauge.se2_kernels import wrap
from slamgauge.sensor_kernels import locate_all, observe_all
from slamgauge.sensors import SENSORS, innovation

WORLD = slice(ROBOT, 2 * ROBOT)  # entries of the world frame; landmarks follow
FIRST = 2 * ROBOT
STILL = np.zeros(3)  # the displacement after composition


class RobocentricBelief:
    """Displacement, world and landmarks in the robot's frame; see `numpy_filter.MovingBelief`.

    Args:
        sensor: `range-bearing` or `position`.
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) covariance of the start pose, world frame.

    Raises:
        UserError: an invalid prior.
    """

    def __init__(self, sensor: str, prior_mean: ArrayLike, prior_cov: ArrayLike) -> None:
        self._origin, start, cov = start_of(prior_mean, prior_cov)
        self._sensor = sensor
        self._mean = np.concatenate([STILL, between(start, STILL)])  # x, y [m], heading [rad] of u and w; landmarks
        back = -np.eye(3)
        back[:2, :2] = -rotation(start[2]).T  # the start is the origin, so the lever of its heading is zero
        self._cov = np.zeros((FIRST, FIRST))
        self._cov[WORLD, WORLD] = symmetric(back @ cov @ back.T)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        displacement, world = self._mean[:ROBOT], self._mean[WORLD]
        pose = between(world, displacement)
        return np.append(self._origin + pose[:2], pose[2])

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        jacobian = pose_jacobian(self._mean[:ROBOT], self._mean[WORLD])
        return without_negative_eigenvalues((jacobian @ self._cov[:FIRST, :FIRST] @ jacobian.T)[None])[0]

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m] in the world frame."""
        return self._origin + self._in_world()

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2]."""
        jacobian = place_jacobian(float(self._mean[5]), self._in_world())
        own = pairs(np.arange(len(jacobian)), FIRST).reshape(-1, 2)
        entries = np.hstack([np.tile(np.arange(ROBOT, FIRST), (len(own), 1)), own])
        covs = jacobian @ self._cov[entries[:, :, None], entries[:, None, :]] @ jacobian.swapaxes(1, 2)
        return without_negative_eigenvalues(covs)

    @property
    def cov(self) -> Float:
        """(n, n) covariance of displacement, world frame and landmarks."""
        return self._cov

    def _in_world(self) -> Float:
        """Return the landmarks (L, 2) [m] in the world frame with the start as origin."""
        return (self._mean[FIRST:].reshape(-1, 2) - self._mean[3:5]) @ rotation(self._mean[5])

    def move(self, increment: Float, cov: Float) -> None:
        """Set the displacement to a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        self._compose()
        self._mean[:ROBOT] = increment
        self._cov[:ROBOT, :ROBOT] = cov

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, 2) of the landmarks in slots (m,); return the NIS and its dof."""
        heading, entries = float(self._mean[2]), pairs(slots, FIRST)
        offset = (self._mean[entries].reshape(-1, 2) - self._mean[:2]) @ rotation(heading)
        predicted, sight = observe_all(SENSORS[self._sensor].code, np.ascontiguousarray(offset))
        jacobian = sight @ place_jacobian(heading, offset)
        informative = (sight != 0.0).any(axis=2)

        def seen(rows: Float) -> Float:  # (n, k) -> (2m, k): H rows
            return times_rows(jacobian, rows[:ROBOT], rows[entries])

        cross = seen(self._cov)
        error = (innovation(self._sensor, values, predicted) * informative).ravel()
        step, self._cov, nis = kalman_step(self._cov, cross, seen(cross.T) + block_diagonal(covs), error, frames=2)
        self._mean = self._mean + step
        self._mean[2], self._mean[5] = wrap(self._mean[2]), wrap(self._mean[5])
        return nis, int(informative.sum())

    def add(self, values: Float, covs: Float) -> None:
        """Map the landmarks of observations (k, 2), in the next slots; they are uncorrelated with the rest."""
        self._compose()
        deltas, jacobian = locate_all(SENSORS[self._sensor].code, values)
        size, more = len(self._mean), 2 * len(values)
        whole = np.zeros((size + more, size + more))
        whole[:size, :size] = self._cov
        whole[size:, size:] = block_diagonal(symmetric(jacobian @ covs @ jacobian.swapaxes(1, 2)))
        self._mean, self._cov = np.concatenate([self._mean, deltas.ravel()]), whole

    def _compose(self) -> None:
        """Transform the world frame and all landmarks to the robot's frame after the displacement."""
        displacement, heading = self._mean[:ROBOT], float(self._mean[2])
        places = np.vstack([self._mean[3:5], self._mean[FIRST:].reshape(-1, 2)])
        offset = (places - displacement[:2]) @ rotation(heading)
        jacobian = place_jacobian(heading, offset)
        moving = np.delete(np.arange(len(self._mean)), [0, 1, 2, 5])  # two entries for each place

        def composed(rows: Float) -> Float:  # (n, k) -> (n, k)
            done = np.zeros_like(rows)
            done[moving] = times_rows(jacobian, rows[:ROBOT], rows[moving])
            done[5] = rows[5] - rows[2]
            return done

        self._cov = symmetric(composed(composed(self._cov).T))
        turned = wrap(self._mean[5] - heading)
        self._mean = np.concatenate([STILL, offset[0], [turned], offset[1:].ravel()])


def pose_jacobian(displacement: Float, world: Float) -> Float:
    """Return the Jacobian (3, 6) of the robot's pose in the world by displacement (3,) and world frame (3,).

    Displacement and world frame are given in the same frame.
    """
    offset = (displacement[:2] - world[:2]) @ rotation(world[2])
    of_place = place_jacobian(float(world[2]), offset[None])[0]
    jacobian = np.zeros((3, 2 * ROBOT))
    jacobian[:2, :2], jacobian[:2, WORLD] = of_place[:, ROBOT:], of_place[:, :ROBOT]
    jacobian[2, 2], jacobian[2, 5] = 1.0, -1.0
    return jacobian
