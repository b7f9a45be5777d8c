"""The online filter that finds out by itself which landmark it sees.

`nearest-neighbour` is the practical's rule: observation by observation, the landmark of the smallest squared
Mahalanobis distance below the gate corrects the filter at once, and if there is none, a new landmark is mapped
at once. `jcbb` associates a whole scan jointly (Neira and Tardos 2001, see `kernels.compatibility`), corrects with
all that was matched in one update, then maps the rest.

Names: a landmark's id is the number of its track, 0, 1, 2, ... in the order of birth, and is never used again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from slamgauge.arrays import Float, Int
from slamgauge.ekf.filter import SOUND, Correction, SlamFilter
from slamgauge.ekf.kernels.compatibility import NONE
from slamgauge.ekf.kernels.take_in import are_sound
from slamgauge.ekf.kernels.warm_up import compile_association_once
from slamgauge.ekf.map_management import Tracks
from slamgauge.ekf.settings.association import NEAREST_NEIGHBOUR, Association
from slamgauge.recording import Observations


class AssociatingFilter:
    """`SlamFilter` for observations without ids.

    Args:
        sensor: `range-bearing` or `position`.
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `SlamFilter`.
        association: how observations find their landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction = "standard",
        association: Association = NEAREST_NEIGHBOUR,
    ) -> None:
        compile_association_once()
        self._slam = SlamFilter(sensor, prior_mean, prior_cov, correction)
        self._association = association
        self._tracks = Tracks(association.map_management)
        self._associated: Int = np.zeros(0, dtype=np.int64)
        self._quantiles = np.zeros(1)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._slam.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._slam.pose_cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the mapped landmarks that are confirmed."""
        return self._slam.landmark_ids[self._tracks.confirmed]

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self._slam.landmarks[self._tracks.confirmed]

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]."""
        return self._slam.landmark_covs[self._tracks.confirmed]

    @property
    def associated(self) -> Int:
        """(m,) id that each observation of the current step was given, -1 if none; see `standing`."""
        return self._associated

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: merged ones have their survivor's, unconfirmed or deleted ones -1."""
        return self._tracks.standing(ids)

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `SlamFilter.predict`."""
        self._slam.predict(increment, cov)
        self._associated = self._associated[:0]

    def update(self, observations: Observations) -> tuple[float, int]:
        """Associate the observations of one step, correct, and map what is new; ids are not looked at.

        Returns:
            The normalised innovation squared and its degrees of freedom.

        Raises:
            ValueError: an update that has no solution; see `SlamFilter.update`.
        """
        values, covs = np.array(observations.value), np.array(observations.cov)
        if not len(values):
            return 0.0, 0
        if not are_sound(values, covs):
            raise ValueError(f"observation: no update exists for this scan; {SOUND}")
        associate = self._jointly if self._association.method == "jcbb" else self._one_by_one
        result = associate(values, covs)
        self._tracks.close_scan(self._slam, self._associated)
        return result

    def _one_by_one(self, values: Float, covs: Float) -> tuple[float, int]:
        gate, next_id, before = self._association.gate, self._tracks.next_id, len(self._tracks.ids)
        slots, nis, dof = self._slam.update_one_by_one(values, covs, gate, self._widest_gate, next_id)
        self._tracks.begin(max(slots.max(initial=NONE) + 1 - before, 0))
        self._associated = np.where(slots == NONE, NONE, self._tracks.ids[slots])
        return nis, dof

    def _jointly(self, values: Float, covs: Float) -> tuple[float, int]:
        pairs, count = self._slam.compatible(values, covs, self._widest_gate)
        gate, limit = self._association.gate, self._association.node_limit
        slots = self._slam.jointly_compatible(len(values), count, gate, self._joint_gates(len(values)), limit)
        management, doubtful = self._association.map_management, np.zeros(len(values), dtype=bool)
        if management is not None:
            slots[self._slam.ambiguous(count, gate, management.margin, slots)] = NONE
            doubtful[pairs.observation[:count][np.isin(pairs.slot[:count], slots, invert=True)]] = True
        matched = slots != NONE
        new = ~matched & ~doubtful
        self._associated = np.full(len(values), NONE)
        self._associated[matched] = self._tracks.ids[slots[matched]]
        result = self._slam.correct(slots[matched], values[matched], covs[matched])
        self._associated[new] = self._add(values[new], covs[new])
        return result

    @property
    def _widest_gate(self) -> float:
        """An observation within this squared distance of a landmark that is not seen otherwise starts no track."""
        management = self._association.map_management
        return self._association.gate if management is None else max(self._association.gate, management.new_gate)

    def _add(self, values: Float, covs: Float) -> Int:
        ids = self._tracks.begin(len(values))
        self._slam.add(ids, values, covs)
        return ids

    def _joint_gates(self, observations: int) -> Float:
        """Largest joint squared distances (m + 1,) of 0, 1, ... m pairs."""
        if len(self._quantiles) <= observations:
            rarer = np.exp(-self._association.gate / 2.0)  # probability beyond the gate, 2 degrees of freedom
            dof = 2.0 * np.arange(1, 2 * observations + 1)
            self._quantiles = np.concatenate([[0.0], chdtri(dof, rarer)])
        return self._quantiles
