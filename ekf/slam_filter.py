"""The online filter for known association."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.ekf.maps.input_checks import ids_of, require_gate, require_ids, require_robustness, rows_of
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings import PLAIN, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations


class SlamFilter(OnlineFilter):
    """Landmark EKF-SLAM with known association and one blocked update per step.

    Args:
        sensor: `range-bearing` or `position` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: `standard`, `first-estimates`, `observability-constrained`, `iterated`, `right-invariant` (see
            `kernels.update`).
        landmarks: initial capacity; the map grows as needed.
        robust: how updates are guarded against outliers.

    Raises:
        UserError: an unknown sensor or correction, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction = "standard",
        landmarks: int = 32,
        robust: Robustness = PLAIN,
    ) -> None:
        self._gate = require_robustness(robust).known_gate
        super().__init__(LandmarkMap(sensor, prior_mean, prior_cov, correction, landmarks, robust.tails))

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
        values, covs = rows_of(observations, self.map.dim)
        ids = ids_of(observations, len(values))
        gate = self._gate if gate is None else gate
        if gate is None:
            nis, dof = self._update(ids, values, covs)
            return self._finished(ids.copy(), nis, dof)
        require_gate(gate)
        require_ids(ids)
        values, covs = np.asarray(values, np.float64), np.asarray(covs, np.float64)
        self.map.require_sound(values, covs)
        ids = self.map.without_outliers(ids, values, covs, gate)
        kept = ids != NONE
        return self._finished(ids, *self._update(ids[kept], values[kept], covs[kept]))

    def _update(self, ids: Int, values: NDArray[np.generic], covs: NDArray[np.generic]) -> tuple[float, int]:
        result = self.map.update(ids, values, covs)
        if result is not None:
            return result
        return self._update_and_map(ids, np.asarray(values, np.float64), np.asarray(covs, np.float64))

    def _update_and_map(self, ids: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with mapped landmarks, then map the new ones.

        A new landmark is mapped by its first observation; its other observations of the step correct it in another
        update.
        """
        require_ids(ids)
        if self.map.dim == 1:
            raise UserError("landmark: one bearing does not place a landmark; use slamgauge.ekf.BearingFilter")
        self.map.require_sound(values, covs)
        mapped, first = np.isin(ids, self.map.ids), np.zeros(len(ids), dtype=np.bool_)
        first[np.unique(ids, return_index=True)[1]] = True
        new, again = first & ~mapped, ~first & ~mapped
        self.map.reserve(self.map.size + 2 * int(new.sum()))  # may raise an error: before any change
        with self.map.transaction(only_addition=not again.any()):
            nis, dof = self.map.update(ids[mapped], values[mapped], covs[mapped]) or (0.0, 0)
            self.map.add(ids[new], values[new], covs[new])
            nis_again, dof_again = self.map.update(ids[again], values[again], covs[again]) or (0.0, 0)
        return nis + nis_again, dof + dof_again
