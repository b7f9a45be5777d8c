"""The online filter for known association."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.maps.correction_table import Correction, Rule
from slamgauge.ekf.maps.divergence_monitor import DivergenceMonitor
from slamgauge.ekf.maps.input_checks import ids_of, require_gate, require_ids, require_robustness, rows_of
from slamgauge.ekf.maps.landmark_ids import of_scan
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import add_landmarks
from slamgauge.ekf.maps.matching import are_within
from slamgauge.ekf.maps.transaction import is_addition_certain, transaction
from slamgauge.ekf.online_filter import PointFilter
from slamgauge.ekf.settings import PLAIN, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations

REJECTED = -1  # in `associated`, an observation beyond the gate
NO_IDS: Int = np.zeros(0, dtype=np.int64)


class SlamFilter(PointFilter):
    """Landmark EKF-SLAM with known association and one blocked update per step.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: `standard`, `first-estimates`, `observability-constrained`, `iterated`, `right-invariant` (see
            `kernels.update`).
        landmarks: initial capacity; the map grows as needed.
        robust: how updates are guarded against outliers.

    Attributes:
        map: state and correction (see `maps.landmark_map`), for other filters and tests.

    Raises:
        UserError: an unknown sensor or correction, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction | Rule = "standard",
        landmarks: int = 32,
        robust: Robustness = PLAIN,
    ) -> None:
        self._gate = require_robustness(robust).known_gate
        self.map = LandmarkMap(sensor, prior_mean, prior_cov, correction, landmarks, robust.tails)
        self._correction = self.map.correction
        self._monitor = DivergenceMonitor(self._correction.rule)
        self._associated = NO_IDS

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self.map.state.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self.map.state.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks: in the order of their first observation, unless some were removed."""
        return self.map.state.ids.copy()

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self.map.state.positions

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self.map.state.position_covs

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of robot and landmarks in the order of `landmark_ids`."""
        return self.map.state.cov

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        The increment of speed v and yaw rate omega over dt is (v dt, 0, omega dt).

        Raises:
            UserError: wrong shapes, a number that is not finite, or an invalid covariance; the filter is unchanged.
        """
        self._correction.predict(increment, cov)
        self._associated = NO_IDS

    def update(self, observations: Observations, gate: float | None = None) -> tuple[float, int]:
        """Correct with all observations of one step, then map the landmarks that are new.

        Args:
            observations: ids (m,), values (m, d) and covariances (m, d, d).
            gate: largest squared Mahalanobis distance of a single observation of a mapped landmark; the filter rejects
                observations beyond it, and `associated` has -1 for them. By default the gate of `robust`.

        Returns:
            The normalised innovation squared of the accepted observations and its degrees of freedom (0, 0 without
            mapped landmarks).

        Raises:
            UserError: no ids, wrong shapes, a negative range, a number that is not finite, a covariance that is not
                positive definite, or no update in double precision; the filter is unchanged.
        """
        values, covs = rows_of(observations, self._correction.dim)
        ids = ids_of(observations, len(values))
        gate = self._gate if gate is None else gate
        if gate is not None:
            return self._monitor.checked(self._update_gated(ids, values, covs, gate))
        result = self._update(ids, values, covs)
        self._associated = ids.copy()
        return self._monitor.checked(result)

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations, -1 for rejected ones."""
        return self._associated

    def _update(self, ids: Int, values: NDArray[np.generic], covs: NDArray[np.generic]) -> tuple[float, int]:
        if not len(ids):
            return 0.0, 0
        result = self._correction.update_by_ids(ids, values, covs)
        if result is not None:
            return result
        return self._update_and_map(ids, np.asarray(values, np.float64), np.asarray(covs, np.float64))

    def _update_and_map(self, ids: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with mapped landmarks, then map the new ones.

        A new landmark is mapped by its first observation; its other observations of the step correct it in another
        update.
        """
        require_ids(ids)
        if self._correction.dim == 1:
            raise UserError("landmark: one bearing does not place a landmark; use slamgauge.ekf.BearingFilter")
        self._correction.require_sound(values, covs)
        mapped, new, again = of_scan(ids, self.map.state.ids)
        self.map.state.reserve(self.map.state.size + 2 * int(new.sum()))  # may raise an error: before any change
        certain = not again.any() and is_addition_certain(self.map)
        with nullcontext() if certain else transaction(self.map):
            total, dof = 0.0, 0
            if mapped.any():
                total, dof = self._update(ids[mapped], values[mapped], covs[mapped])
            add_landmarks(self.map, ids[new], values[new], covs[new])
            if again.any():
                nis, informative = self._update(ids[again], values[again], covs[again])
                total, dof = total + nis, dof + informative
        return total, dof

    def _update_gated(
        self, ids: Int, values: NDArray[np.generic], covs: NDArray[np.generic], gate: float
    ) -> tuple[float, int]:
        require_gate(gate)
        values, covs = np.asarray(values, np.float64), np.asarray(covs, np.float64)
        self._correction.require_sound(values, covs)
        kept = np.ones(len(ids), dtype=bool)
        rows = np.flatnonzero(np.isin(ids, self.map.state.ids))
        kept[rows] = are_within(self.map, self.map.state.slots_of(ids[rows]), values[rows], covs[rows], gate)
        result = self._update(ids[kept], values[kept], covs[kept])
        self._associated = np.where(kept, ids, REJECTED)
        return result
