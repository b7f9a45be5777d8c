"""The right-invariant filter with sigma points (UKF-M).

Source: Brossard, Barrau and Bonnabel, "A Code for Unscented Kalman Filtering on Manifolds (UKF-M)", ICRA 2020; the
scaled unscented transform is Julier's (ACC 2002) with beta = 2.

Notation, as in `kernels.corrections`: ^ marks an estimate and ' a transpose. R(t) is the rotation by t, J the rotation
by 90 degrees, and V(t) the mean of the rotations from 0 to t (`se2.mean_rotation`). R without an argument is the
rotation by the robot's heading. x is the position p of the robot or the position l of a landmark.

The right-invariant error xi = (xi_x, t) is defined by heading = heading^ + t and x = R(t) x^ + V(t) xi_x. The filter
stores the covariance of the error e, which has the same t and e_x = xi_x + J x^ t. Because R(t) - I = V(t) J t,

    x = x^ + V(t) e_x    for the robot's position and every landmark.

To first order, e is therefore the additive error in the world frame. A motion of the robot changes only the robot's
rows and columns of the covariance. Sigma points are drawn only for the coordinates on which a step depends nonlinearly:

* Prediction: a motion without noise leaves xi unchanged, exactly. Noise of the increment, w_d in translation and w_t in
  heading, adds t = w_t and e_p = V(t)^-1 R w_d. This is linear unless w_d and w_t are correlated.
* Correction: the position of a landmark in the robot's frame is delta = delta^ + V(-t) c with
  c = R' (e_l - e_p) - J delta^ t. Sigma points are drawn for c of all observed landmarks and for the part of t that is
  correlated with c. The independent part of t changes no observation, because translation and rotation of the whole
  map are unobservable.
* Augmentation: sigma points are drawn for the noise of the observation. The correlations of a new landmark follow
  linearly from the robot's rows.

Roots of the covariance of c are symmetric, so that the result does not depend on the order of landmarks. As in UKF-M,
the means of prediction and augmentation are the values without noise, and second moments are computed about these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.dense_algebra import (
    block_diagonal,
    kalman_step,
    pairs,
    place_jacobian,
    symmetric,
    times_rows,
)
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.rounding_limits import LEAST
from slamgauge.ekf.maps.input_checks import start_of
from slamgauge.se2 import mean_rotation, rotation
from slamgauge.se2_kernels import wrap
from slamgauge.sensor_kernels import locate_all, observe_all
from slamgauge.sensors import SENSORS, innovation

SPREAD = 3.0**0.5  # sigmas from the mean to a sigma point: exact for the first four moments of a normal distribution
WEIGHT = 0.5 / SPREAD**2  # weight of a sigma point
BETA = 2.0  # optimal for a normal distribution


class InvariantBelief:
    """Robot and landmarks with a right-invariant error; see `numpy_filter.MovingBelief`.

    Args:
        sensor: `range-bearing` or `position`.
        prior_mean: (3,) start pose x, y [m], heading [rad], world frame.
        prior_cov: (3, 3) covariance of the start pose, world frame.

    Raises:
        UserError: an invalid prior.
    """

    def __init__(self, sensor: str, prior_mean: ArrayLike, prior_cov: ArrayLike) -> None:
        self._origin, self._mean, cov = start_of(prior_mean, prior_cov)  # x, y [m], heading [rad], landmarks
        self._cov = cov.copy()
        self._sensor = sensor

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return np.append(self._origin + self._mean[:2], self._mean[2])

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame, to first order."""
        return self._cov[:ROBOT, :ROBOT].copy()

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m] in the world frame."""
        return self._origin + self._mean[ROBOT:].reshape(-1, 2)

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2], world frame, to first order."""
        count = len(self._mean) // 2 - 1
        return self._cov[ROBOT:, ROBOT:].reshape(count, 2, count, 2)[np.arange(count), :, np.arange(count)]

    @property
    def cov(self) -> Float:
        """(n, n) covariance of e: x, y, heading of the robot, then x, y of each landmark; n = 3 + 2 L."""
        return self._cov

    def move(self, increment: Float, cov: Float) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        turn = rotation(self._mean[2])
        step = turn @ increment[:2]
        lever = _quarter_turned(step)  # D of the new position times D^-1 of the old one is I + lever e_theta'
        self._cov[:2] += np.outer(lever, self._cov[2])
        self._cov[:, :2] += np.outer(self._cov[:, 2], lever)
        self._cov[:ROBOT, :ROBOT] = symmetric(self._cov[:ROBOT, :ROBOT] + motion_noise(turn, cov))
        self._mean[:2] += step
        self._mean[2] = wrap(self._mean[2] + increment[2])

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, 2), covariances (m, 2, 2), of the landmarks with indices `slots` (m,).

        Returns:
            The NIS and its degrees of freedom.
        """
        seen, which = np.unique(slots, return_inverse=True)
        heading, entries = float(self._mean[2]), pairs(seen, ROBOT)
        offset = (self._mean[entries].reshape(-1, 2) - self._mean[:2]) @ rotation(heading)
        jacobian = place_jacobian(heading, offset)

        def relative(rows: Float) -> Float:  # (n, k) -> (2s, k): c
            return times_rows(jacobian, rows[:ROBOT], rows[entries])

        joint = relative(self._cov)
        factor, inverse = symmetric_roots(relative(joint.T))
        whitened = inverse @ joint
        predicted, informative, changes = self._seen_from_sigma_points(offset, factor, whitened[:, 2])
        changes = changes[:, which].reshape(len(changes), -1)  # (4s, 2m)
        mean, second = moments(changes)
        ahead, behind = np.split(changes, 2)
        cross = WEIGHT * SPREAD * (ahead - behind).T @ whitened
        error = innovation(self._sensor, values, predicted[which]) * informative[which]
        error = innovation(self._sensor, error, mean.reshape(-1, 2)).ravel()
        step, cov, nis = kalman_step(self._cov, cross, second + block_diagonal(covs), error, frames=1)
        self._mean, self._cov = moved(self._mean, cov, step)
        return nis, int(informative[which].sum())

    def _seen_from_sigma_points(self, offset: Float, factor: Float, turns: Float) -> tuple[Float, Float, Float]:
        """Return the observations that are predicted at the mean, and their changes at the sigma points.

        Args:
            offset: (s, 2) landmarks in the robot's frame [m].
            factor: (2s, 2s) root of the covariance of c.
            turns: (2s,) part of t [rad] that belongs to each column of `factor`.

        Returns:
            Predictions (s, 2); 1 for each value that depends on the landmark's position and 0 for others (s, 2); and
            the changes of the predictions at the 4s sigma points (4s, s, 2).
        """
        code = SENSORS[self._sensor].code
        points = SPREAD * np.vstack([factor.T, -factor.T]).reshape(4 * len(offset), -1, 2)
        back = mean_rotation(SPREAD * np.concatenate([-turns, turns]))
        deltas = offset + points @ back.swapaxes(1, 2)
        predicted, jacobian = observe_all(code, np.ascontiguousarray(offset))
        informative = (jacobian != 0.0).any(axis=2).astype(np.float64)
        values = observe_all(code, deltas.reshape(-1, 2))[0].reshape(deltas.shape)
        return predicted, informative, innovation(self._sensor, values, predicted) * informative

    def add(self, values: Float, covs: Float) -> None:
        """Append the landmarks of observations (k, 2), covariances (k, 2, 2), to the state."""
        code, turn, count = SENSORS[self._sensor].code, rotation(self._mean[2]), len(values)
        roots = np.linalg.cholesky(covs).swapaxes(1, 2)  # rows are columns of the Cholesky factor
        deltas = locate_all(code, values)[0]
        points = values[:, None] + SPREAD * np.concatenate([roots, -roots], axis=1)
        changes = locate_all(code, points.reshape(-1, 2))[0].reshape(count, 4, 2) - deltas[:, None]
        noise = np.array([about_zero(each @ turn.T) for each in changes])
        offset = deltas @ turn.T
        copies = np.zeros((count, 2, ROBOT))
        copies[:, :, :2], copies[:, :, 2] = np.eye(2), _quarter_turned(offset)
        rows = copies.reshape(-1, ROBOT) @ self._cov[:ROBOT]
        own = symmetric(rows[:, :ROBOT] @ copies.reshape(-1, ROBOT).T) + block_diagonal(noise)
        self._mean = np.concatenate([self._mean, (self._mean[:2] + offset).ravel()])
        self._cov = np.block([[self._cov, rows.T], [rows, own]])


def symmetric_roots(cov: Float) -> tuple[Float, Float]:
    """Return the symmetric root (d, d) of a covariance and its inverse.

    Unlike a Cholesky factor, the symmetric root does not depend on the order of landmarks.

    Raises:
        LinAlgError: the covariance is singular up to rounding.
    """
    variances, axes = np.linalg.eigh(cov)
    if not variances[0] > LEAST * variances[-1]:
        raise np.linalg.LinAlgError("singular")
    sigmas = np.sqrt(variances)
    return (axes * sigmas) @ axes.T, (axes / sigmas) @ axes.T


def moments(changes: Float) -> tuple[Float, Float]:
    """Return mean (m,) and covariance (m, m) of the change of a function.

    Args:
        changes: (2d, m) differences between the function at the 2d sigma points and at the mean of its argument.
    """
    mean = WEIGHT * changes.sum(axis=0)
    alpha_squared = SPREAD**2 / (len(changes) // 2)
    return mean, WEIGHT * (changes.T @ changes) + (BETA - alpha_squared) * np.outer(mean, mean)


def about_zero(changes: Float) -> Float:
    """Return the second moments (m, m) of the change of a function; `changes` (2d, m) as in `moments`."""
    mean, cov = moments(changes)
    return cov + np.outer(mean, mean)


def motion_noise(turn: Float, cov: Float) -> Float:
    """Return the second moments (3, 3) that the noise of an increment adds to the robot's part of e.

    The part of the translation noise that is independent of the heading noise is linear and needs no sigma points.

    Args:
        turn: (2, 2) rotation matrix of the heading before the increment.
        cov: (3, 3) covariance of the increment, body frame.
    """
    heading_sigma = np.sqrt(max(cov[2, 2], 0.0))
    with_turn = cov[:2, 2] / heading_sigma if heading_sigma > 0.0 else np.zeros(2)
    t = SPREAD * heading_sigma * np.array([1.0, -1.0])
    moves = SPREAD * np.outer([1.0, -1.0], turn @ with_turn)
    changes = np.column_stack([np.linalg.solve(mean_rotation(t), moves[:, :, None])[:, :, 0], t])
    noise = about_zero(changes)
    noise[:2, :2] += turn @ (cov[:2, :2] - np.outer(with_turn, with_turn)) @ turn.T
    return noise


def moved(mean: Float, cov: Float, step: Float) -> tuple[Float, Float]:
    """Return the state (n,) and covariance (n, n) after a correction of e.

    The definition of e contains the estimate, so the covariance is transformed to the corrected estimate.

    Args:
        mean: (n,) state before the correction.
        cov: (n, n) covariance of e after the Kalman update.
        step: (n,) correction of e.
    """
    V = mean_rotation(step[2])
    robot, landmarks = V @ step[:2], step[ROBOT:].reshape(-1, 2) @ V.T
    lever = np.concatenate([_quarter_turned(robot), [0.0], _quarter_turned(landmarks).ravel()])
    shared = np.outer(lever, cov[2] + 0.5 * cov[2, 2] * lever)
    there = np.concatenate([mean[:2] + robot, [wrap(mean[2] + step[2])], mean[ROBOT:] + landmarks.ravel()])
    return there, cov + (shared + shared.T)


def _quarter_turned(vectors: Float) -> Float:
    """Return J v, vectors v (..., 2) rotated by 90 degrees."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], -1)
