"""The online filter for observations without ids.

`nearest-neighbour` is the rule of the exercise. It takes one observation after the other: the landmark with the
smallest squared Mahalanobis distance within the gate corrects the filter; without such a landmark a new one is mapped.
`jcbb` associates a whole scan jointly (Neira and Tardos 2001, see `kernels.joint_compatibility`), corrects with all
matched observations in one update, then maps the rest.

The id of a landmark is the number of its track, 0, 1, 2, ... in the order of birth; it is never used again.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.kernels.individual_compatibility import find_compatible
from slamgauge.ekf.kernels.joint_compatibility import search_jointly
from slamgauge.ekf.kernels.nearest_neighbour import Gates, update_nearest
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.ekf.maps.input_checks import explain_scan, require_robustness, require_sensor, rows_of
from slamgauge.ekf.maps.landmark_map import LandmarkMap, two_rows
from slamgauge.ekf.maps.tracks import Tracks
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, Association, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.sensors import PLACING


class AssociatingFilter(OnlineFilter):
    """`SlamFilter` for observations without ids. Its landmarks are the confirmed tracks.

    Args:
        sensor: `range-bearing` or `position`.
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `SlamFilter`.
        association: method, gate and map management.
        robust: `student-t` or `none`; the gate is that of the association.

    Raises:
        UserError: an unknown or unsuitable sensor, correction or method, or an invalid prior.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction = "standard",
        association: Association = NEAREST_NEIGHBOUR,
        robust: Robustness = PLAIN,
    ) -> None:
        require_sensor(sensor, PLACING)
        tails = require_robustness(robust).tails
        super().__init__(LandmarkMap(sensor, prior_mean, prior_cov, correction, tails=tails))
        if not isinstance(cast("object", association), Association):
            raise UserError(f"association: {association!r} is not an Association; give Association(method, gate)")
        self._association = association
        self._tracks = Tracks(self.map, association.map_management)
        self._quantiles = np.zeros(1)

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks that are confirmed."""
        return self.map.ids[self._tracks.confirmed]

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self.map.positions[self._tracks.confirmed]

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self.map.position_covs[self._tracks.confirmed]

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids: that of the merged landmark, or -1 if unconfirmed or deleted."""
        return self._tracks.standing(ids)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Associate the observations of one step, correct, and map new landmarks; ids are ignored.

        Returns:
            The normalised innovation squared and its degrees of freedom.

        Raises:
            UserError: no update exists; see `SlamFilter.update`.
        """
        given, given_covs = rows_of(observations, self.map.dim)
        if not len(given):
            return self._finished(np.zeros(0, dtype=np.int64), 0.0, 0)
        values, covs = np.array(given, dtype=np.float64), np.array(given_covs, dtype=np.float64)
        self.map.require_sound(values, covs)
        associate = self._jointly if self._association.method == "jcbb" else self._one_by_one
        associated, nis, dof = associate(values, covs)
        self._tracks.close_scan(associated)
        return self._finished(associated, nis, dof)

    def _one_by_one(self, values: Float, covs: Float) -> tuple[Int, float, int]:
        landmarks, count, before = self.map, len(values), self.map.size
        landmarks.reserve(before + 2 * count)
        gates, work = Gates(self._association.gate, self._widest_gate), landmarks.loaded(values, covs)
        # P changes after the last block only
        with landmarks.transaction(only_addition=count <= landmarks.rule.block):
            update = update_nearest(landmarks.code, landmarks.belief, count, gates, landmarks.form, work)
            variances = np.diagonal(landmarks.belief.cov)[: update.size]
            if not (math.isfinite(update.nis) and np.isfinite(variances).all()):
                raise explain_scan(landmarks.sensor, values, covs, update.nis, variances)
        landmarks.append(landmarks.take_ids((update.size - before) // 2))
        landmarks.require_settled(update.passes)
        return np.where(update.slots == NONE, NONE, landmarks.ids[update.slots]), update.nis, update.dof

    def _jointly(self, values: Float, covs: Float) -> tuple[Int, float, int]:
        observed, gates = two_rows(values, covs), self._joint_gates(len(values))
        pairs = find_compatible(self.map.code, self.map.belief, *observed, self._widest_gate)
        settings = self._association
        slots, _ = search_jointly(self.map.belief.cov, observed[1], pairs, settings.gate, gates, settings.node_limit)
        matched, new = slots != NONE, slots == NONE
        if settings.map_management is not None:  # a possible outlier of another landmark starts no track
            new[pairs.observation[np.isin(pairs.slot, slots, invert=True)]] = False
        associated = np.full(len(values), NONE)
        associated[matched] = self.map.ids[slots[matched]]
        self.map.reserve(self.map.size + 2 * int(new.sum()))  # may raise an error: before any change
        with self.map.transaction(only_addition=True):
            nis, dof = self.map.update(associated[matched], values[matched], covs[matched]) or (0.0, 0)
            associated[new] = self.map.take_ids(int(new.sum()))
            self.map.add(associated[new], values[new], covs[new])
        return associated, nis, dof

    @property
    def _widest_gate(self) -> float:
        """Squared distance of a landmark that is not observed otherwise within which an observation starts no track."""
        management = self._association.map_management
        return self._association.gate if management is None else max(self._association.gate, management.new_gate)

    def _joint_gates(self, observations: int) -> Float:
        """Return the largest joint squared distances (m + 1,) of 0, 1, ... m pairs."""
        if len(self._quantiles) <= observations:
            rarer = np.exp(-self._association.gate / 2.0)  # probability beyond the gate, 2 degrees of freedom
            dof = 2.0 * np.arange(1, 2 * observations + 1)
            self._quantiles = np.concatenate([[0.0], chdtri(dof, rarer)])
        return self._quantiles
