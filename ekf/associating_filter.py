"""The online filter for observations without ids.

`nearest-neighbour` is the rule of the exercise. It takes one observation after the other: the landmark with the
smallest squared Mahalanobis distance within the gate corrects the filter; without such a landmark a new one is mapped.
`jcbb` associates a whole scan jointly (Neira and Tardos 2001, see `kernels.joint_compatibility`), corrects with all
matched observations in one update, then maps the rest.

The id of a landmark is the number of its track, 0, 1, 2, ... in the order of birth; it is never used again.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.individual_compatibility import NONE
from slamgauge.ekf.kernels.nearest_neighbour import Gates
from slamgauge.ekf.maps.correction_table import Correction, Rule
from slamgauge.ekf.maps.divergence_monitor import DivergenceMonitor
from slamgauge.ekf.maps.input_checks import require_robustness, require_sensor, rows_of
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import add_landmarks
from slamgauge.ekf.maps.matching import Matcher, update_nearest
from slamgauge.ekf.maps.tracks import Tracks
from slamgauge.ekf.maps.transaction import is_addition_certain, transaction
from slamgauge.ekf.online_filter import PointFilter
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, Association, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.sensors import PLACING


class AssociatingFilter(PointFilter):
    """`SlamFilter` for observations without ids.

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
        correction: Correction | Rule = "standard",
        association: Association = NEAREST_NEIGHBOUR,
        robust: Robustness = PLAIN,
    ) -> None:
        require_sensor(sensor, PLACING)
        self._map = LandmarkMap(
            sensor, prior_mean, prior_cov, correction, landmarks=32, tails=require_robustness(robust).tails
        )
        if not isinstance(cast("object", association), Association):
            raise UserError(f"association: {association!r} is not an Association; give Association(method, gate)")
        rule = self._map.correction.rule
        if association.method != "nearest-neighbour":
            self._matcher = Matcher(self._map)
        self._association = association
        self._tracks = Tracks(self._map, association.map_management)
        self._associated: Int = np.zeros(0, dtype=np.int64)
        self._quantiles = np.zeros(1)
        self._monitor = DivergenceMonitor(rule)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._map.state.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._map.state.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks that are confirmed."""
        return self._map.state.ids[self._tracks.confirmed]

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self._map.state.positions[self._tracks.confirmed]

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self._map.state.position_covs[self._tracks.confirmed]

    @property
    def associated(self) -> Int:
        """(m,) landmark of each observation of the current step, -1 without one; see `standing`."""
        return self._associated

    def standing(self, ids: Int) -> Int:
        """Return the present ids of earlier ids: that of the merged landmark, or -1 if unconfirmed or deleted."""
        return self._tracks.standing(ids)

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `SlamFilter.predict`."""
        self._map.correction.predict(increment, cov)
        self._associated = self._associated[:0]

    def update(self, observations: Observations) -> tuple[float, int]:
        """Associate the observations of one step, correct, and map new landmarks; ids are ignored.

        Returns:
            The normalised innovation squared and its degrees of freedom.

        Raises:
            UserError: no update exists; see `SlamFilter.update`.
        """
        given, given_covs = rows_of(observations, self._map.correction.dim)
        if not len(given):
            self._associated = self._associated[:0]
            return 0.0, 0
        values, covs = np.array(given, dtype=np.float64), np.array(given_covs, dtype=np.float64)
        self._map.correction.require_sound(values, covs)
        associate = self._jointly if self._association.method == "jcbb" else self._one_by_one
        self._associated, nis, dof = associate(values, covs)
        self._tracks.close_scan(self._associated)
        return self._monitor.checked((nis, dof))

    def _one_by_one(self, values: Float, covs: Float) -> tuple[Int, float, int]:
        gates = Gates(float(self._association.gate), float(self._widest_gate))
        slots, nis, dof = update_nearest(self._map, self._tracks.new_ids, values, covs, gates)
        return np.where(slots == NONE, NONE, self._map.state.ids[slots]), nis, dof

    def _jointly(self, values: Float, covs: Float) -> tuple[Int, float, int]:
        pairs, noise_covs = self._matcher.compatible(values, covs, self._widest_gate)
        gate, limit = self._association.gate, self._association.node_limit
        slots = self._matcher.jointly_compatible(pairs, noise_covs, gate, self._joint_gates(len(values)), limit)
        matched, new = slots != NONE, slots == NONE
        if self._association.map_management is not None:  # a possible outlier of another landmark starts no track
            new[pairs.observation[np.isin(pairs.slot, slots, invert=True)]] = False
        associated = np.full(len(values), NONE)
        associated[matched] = self._map.state.ids[slots[matched]]
        self._map.state.reserve(self._map.state.size + 2 * int(new.sum()))  # may raise an error: before any change
        with nullcontext() if is_addition_certain(self._map) else transaction(self._map):
            nis, dof = self._map.correction.update(slots[matched], values[matched], covs[matched])
            associated[new] = self._tracks.new_ids.given + np.arange(new.sum())
            add_landmarks(self._map, associated[new], values[new], covs[new])
        self._tracks.new_ids.take(int(new.sum()))
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
