"""The online form of filters that are written in numpy: what they have in common is here, what they are is theirs.

A `MovingBelief` is such a filter's state, covariance and steps. `RelativeFilter` drives it with known ids, and refuses
what cannot be taken in; the functions below it are the linear algebra that they share.
"""

from __future__ import annotations

import copy
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.precision import EXHAUSTED, LARGEST, LEAST
from slamgauge.ekf.kernels.prediction import is_semidefinite
from slamgauge.ekf.kernels.warm_up import compile_relatives_once
from slamgauge.ekf.maps.checks import (
    explain_increment,
    explain_scan,
    ids_of,
    load_increment,
    require_ids,
    require_sensor,
    require_sound,
    rows_of,
)
from slamgauge.ekf.maps.ids import of_scan
from slamgauge.ekf.online import PointFilter
from slamgauge.recording import OBSERVATION_DIM, Observations
from slamgauge.se2 import rotation, wrap

SENSORS = ("range-bearing", "position")


class MovingBelief(Protocol):
    """State and covariance of robot and landmarks, and what steps do to them.

    `correct` and `add` put new arrays in the place of the old ones and never write into them: a copy of the belief
    stays what it was.
    """

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        ...

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        ...

    @property
    def landmarks(self) -> Float:
        """(L, 2) [m] in the world frame."""
        ...

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        ...

    @property
    def cov(self) -> Float:
        """(n, n) of the state, in its own coordinates."""
        ...

    def move(self, increment: Float, cov: Float) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3)."""
        ...

    def correct(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with sights (m, 2) of the landmarks in slots (m,); the NIS and its degrees of freedom."""
        ...

    def add(self, values: Float, covs: Float) -> None:
        """Map the landmarks that are seen at values (k, 2), in the next slots."""
        ...


class RelativeFilter(PointFilter):
    """Landmark SLAM with known association, of any belief; a step is that of `SlamFilter`.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        belief: of the start.

    Attributes:
        belief: as it is now.

    Raises:
        UserError: a sensor that does not fit.
    """

    def __init__(self, sensor: str, belief: MovingBelief) -> None:
        require_sensor(sensor, SENSORS)
        compile_relatives_once()
        self._sensor = sensor
        self.belief = belief
        self._slot_of: dict[int, int] = {}
        self._increment, self._increment_cov = np.empty(3), np.empty((3, 3))
        self._associated: Int = np.zeros(0, np.int64)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self.belief.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.belief.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks in the order of their first observation."""
        return np.array([*self._slot_of], dtype=np.int64)

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self.belief.landmarks

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self.belief.landmark_covs

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations."""
        return self._associated

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: shapes that do not fit, a number that is not finite, or no covariance; the filter is unchanged.
        """
        move, move_cov = self._increment, self._increment_cov
        load_increment(increment, cov, move, move_cov)
        believable = np.abs(move).max() < LARGEST and np.abs(move_cov).max() < LARGEST**2
        if not (believable and is_semidefinite(move_cov)):
            raise explain_increment(move, move_cov)
        self.belief.move(move, move_cov)
        self._associated = np.zeros(0, np.int64)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Correct with all observations of one step, then map the landmarks that are new.

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without mapped landmarks).

        Raises:
            UserError: no ids, shapes that do not fit, a negative range, a number that is not finite, a covariance that
                is not positive definite, or no update in double precision; the filter is then unchanged.
        """
        values, covs = rows_of(observations, OBSERVATION_DIM[self._sensor])
        ids = ids_of(observations, len(values))
        require_ids(ids)
        require_sound(self._sensor, values, covs)
        values, covs = np.asarray(values, np.float64), np.asarray(covs, np.float64)
        belief, slot_of = copy.copy(self.belief), self._slot_of
        mapped, new, again = of_scan(ids, self.landmark_ids)
        total, dof = 0.0, 0
        try:
            for rows in (mapped, again):
                if rows.any():
                    slots = np.array([slot_of[each] for each in ids[rows].tolist()])
                    nis, informative = belief.correct(slots, values[rows], covs[rows])
                    total, dof = total + nis, dof + informative
                if rows is mapped and new.any():
                    belief.add(values[new], covs[new])
                    slot_of = slot_of | {each: len(slot_of) + k for k, each in enumerate(ids[new].tolist())}
        except np.linalg.LinAlgError:
            raise explain_scan(self._sensor, values, covs, EXHAUSTED, np.diagonal(belief.cov)) from None
        if not (np.isfinite(total) and np.isfinite(np.diagonal(belief.cov)).all()):
            raise explain_scan(self._sensor, values, covs, total, np.diagonal(belief.cov))
        self.belief, self._slot_of, self._associated = belief, slot_of, ids.copy()
        return total, dof


def kalman_step(
    cov: Float, cross: Float, innovation_cov: Float, innovation: Float, frames: int
) -> tuple[Float, Float, float]:
    """What an innovation (m,) says: the correction (n,), the covariance (n, n) after it, and the NIS.

    Args:
        cov: (n, n) P before.
        cross: (m, n) covariance of innovation and state, H P in a linear model.
        innovation_cov: (m, m) S, positive definite.
        innovation: (m,).
        frames: how many poses the state begins with; places follow.

    Raises:
        LinAlgError: S is not positive definite, or what is left of a variance is no more than rounding.
    """
    root = np.linalg.cholesky(innovation_cov)
    whitened = solve_triangular(root, np.column_stack([cross, innovation]), lower=True, check_finite=False)
    gain, surprise = whitened[:, :-1].copy(), whitened[:, -1]
    before, taken = (_by_place(each, frames) for each in (np.diagonal(cov), (gain**2).sum(axis=0)))
    if ((taken > 0.0) & ~(before - taken > LEAST * before)).any():
        raise np.linalg.LinAlgError("exhausted")
    return surprise @ gain, cov - gain.T @ gain, float(surprise @ surprise)


def _by_place(variances: Float, frames: int) -> Float:
    """Variances (n,) of headings, and of places both together: one alone may be rounding from the beginning."""
    poses, places = variances[: 3 * frames].reshape(-1, 3), variances[3 * frames :].reshape(-1, 2)
    return np.concatenate([poses[:, 2], poses[:, :2].sum(axis=1), places.sum(axis=1)])


def place_jacobian(heading: float, offset: Float) -> Float:
    """Jacobians (s, 2, 5) of places as a robot sees them, R(heading)' (l - p), by robot x, y, heading and place x, y.

    Args:
        heading: of the robot [rad].
        offset: (s, 2) the places in the robot's frame [m].
    """
    back = rotation(heading).T
    jacobian = np.empty((len(offset), 2, 5))
    jacobian[:, :, :2], jacobian[:, :, 3:] = -back, back
    jacobian[:, 0, 2], jacobian[:, 1, 2] = offset[:, 1], -offset[:, 0]
    return jacobian


def times_rows(jacobian: Float, robot: Float, places: Float) -> Float:
    """Products (2s, k) of Jacobians (s, 2, 5) and rows: the robot's (3, k), and two for each place (2s, k)."""
    of_places = jacobian[:, :, 3:] @ places.reshape(-1, 2, places.shape[1])
    return (jacobian[:, :, :3] @ robot + of_places).reshape(places.shape)


def pairs(slots: Int, first: int) -> Int:
    """Both entries (2s,) of each slot (s,), if slot 0 begins at entry `first`."""
    return (first + 2 * slots[:, None] + [0, 1]).ravel()


def block_diagonal(blocks: Float) -> Float:
    """Matrix (2m, 2m) of blocks (m, 2, 2)."""
    count = len(blocks)
    whole = np.zeros((count, 2, count, 2))
    whole[np.arange(count), :, np.arange(count)] = blocks
    return whole.reshape(2 * count, 2 * count)


def symmetric(matrices: Float) -> Float:
    """The symmetric part of matrices (..., n, n): what is left out is rounding."""
    return (matrices + matrices.swapaxes(-1, -2)) / 2


def difference(sensor: str, one: Float, other: Float) -> Float:
    """Differences (..., 2) of observations; those of bearings are wrapped."""
    apart = one - other
    if sensor == "range-bearing":
        apart[..., 1] = wrap(apart[..., 1])
    return apart
