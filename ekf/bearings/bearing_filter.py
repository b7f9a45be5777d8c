"""The online filter for bearing-only sensors.

A landmark starts as a provisional landmark of the initialiser: as a ray of members (`rays`), or
waiting for more bearings (`delayed`). Later it becomes a point of the map. A scan corrects with
all bearings of points at once, then with those of provisional landmarks.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.delayed import DelayedInitialiser
from slamgauge.ekf.bearings.rays import RayInitialiser
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.ekf.maps.input_checks import ids_of, require_gate, require_ids, require_robustness, rows_of
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.online_filter import Members, OnlineFilter, joined, points
from slamgauge.ekf.settings import PLAIN, Delayed, Initialisation, Rays, Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import RayLog
from slamgauge.recording import Observations


class BearingFilter(OnlineFilter):
    """Online bearing-only SLAM.

    Args:
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `SlamFilter`.
        initialisation: how landmarks are initialised; by default as rays.
        robust: how updates by points are guarded against outliers; provisional landmarks have the gate of their
            initialisation.

    Raises:
        UserError: an unknown correction or initialisation, or an invalid prior.
    """

    def __init__(
        self,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction = "standard",
        initialisation: Initialisation | None = None,
        robust: Robustness = PLAIN,
    ) -> None:
        initialisation = Rays() if initialisation is None else initialisation
        self._gate = require_robustness(robust).known_gate
        super().__init__(LandmarkMap("bearing", prior_mean, prior_cov, correction, tails=robust.tails))
        self._provisional = _initialiser(self.map, initialisation)

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks: points, and provisional landmarks with a position."""
        return self._landmarks().landmark

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m]; for a ray that of its heaviest member."""
        return self._landmarks().position

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]; for a ray that of its heaviest member."""
        return self._landmarks().cov

    @property
    def provisional(self) -> dict[int, int]:
        """Number of members of each landmark that is not a point yet."""
        return self._provisional.counts

    @property
    def member_count(self) -> int:
        """Number of members of all provisional landmarks."""
        return sum(self._provisional.counts.values())

    def ray_log(self, members: Int) -> RayLog | None:
        """Return the log of the rays, with the number of members (N+1,) after each step; None without rays."""
        return self._provisional.log(members)

    def standing(self, ids: Int) -> Int:
        """Return the ids, -1 for deleted landmarks."""
        known = np.isin(ids, self.landmark_ids)
        return ids if known.all() else np.where(known, ids, NONE)

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `OnlineFilter.predict`."""
        super().predict(increment, cov)
        self._provisional.step += 1

    def update(self, observations: Observations, gate: float | None = None) -> tuple[float, int]:
        """Correct with the bearings of points, then process those of provisional and new landmarks.

        Args:
            observations: ids (m,), bearings (m, 1) and variances (m, 1, 1).
            gate: largest squared Mahalanobis distance of a bearing of a point; bearings beyond it are rejected, and
                `associated` has -1 for them. Provisional landmarks have the gate of their initialisation.

        Returns:
            The normalised innovation squared of the points and its degrees of freedom.

        Raises:
            UserError: no ids, wrong shapes, a number that is not finite, a variance
                that is not positive, or no update in double precision; the filter is unchanged.
        """
        gate = self._gate if gate is None else gate
        require_gate(gate)
        given, given_covs = rows_of(observations, 1)
        ids = ids_of(observations, len(given))
        if not len(given):
            return self._finished(ids[:0], 0.0, 0)
        values, covs = np.asarray(given, np.float64), np.asarray(given_covs, np.float64)
        self.map.require_sound(values, covs)
        require_ids(ids)
        ids = self.map.without_outliers(ids, values, covs, gate)
        result = self.map.update(ids, values, covs)
        if result is not None:  # all are points
            return self._finished(ids, *result)
        before = self._provisional.copy()
        try:
            with self.map.transaction():
                return self._finished(ids, *self._update(ids, values, covs))
        except BaseException:
            self._provisional = before
            raise

    def _update(self, ids: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with the bearings of points, then with the first one of each other landmark; repeat with the rest."""
        total, dof, names, left = 0.0, 0, ids.tolist(), np.flatnonzero(ids != NONE).tolist()
        while left:
            mapped, first = {*self.map.ids.tolist()}, dict[int, int]()
            rows = [row for row in left if names[row] in mapped]
            nis, informative = self.map.update(ids[rows], values[rows], covs[rows]) or (0.0, 0)
            others = [row for row in left if names[row] not in mapped]
            for row in others:
                first.setdefault(names[row], row)
            rows = [*first.values()]
            self._provisional.observe([*first], values[rows], covs[rows])
            total, dof, left = total + nis, dof + informative, [row for row in others if row not in rows]
        return total, dof

    def _landmarks(self) -> Members:
        """Return a row for every landmark, points first; of a ray the heaviest member, else the nearest."""
        rows = self.whole_map()
        order = np.lexsort((-rows.number, rows.weight, rows.landmark))
        heaviest = order[np.diff(rows.landmark[order], append=NONE) != 0]
        heaviest.sort()
        landmark, number, weight = rows.landmark[heaviest], rows.number[heaviest], rows.weight[heaviest]
        return Members(landmark, number, weight, rows.position[heaviest], rows.cov[heaviest])

    def whole_map(self) -> Members:
        """Return every point and every member of provisional landmarks."""
        are_points = self.map.ids >= 0
        known = self.map.ids[are_points], self.map.positions[are_points], self.map.position_covs[are_points]
        return joined([points(*known), self._provisional.members()])


def _initialiser(landmarks: LandmarkMap, initialisation: Initialisation) -> RayInitialiser | DelayedInitialiser:
    if isinstance(initialisation, Rays):
        return RayInitialiser(landmarks, initialisation)
    if isinstance(cast("object", initialisation), Delayed):
        return DelayedInitialiser(landmarks, initialisation)
    raise UserError(f"initialisation: {initialisation!r} is not known; give Rays() or Delayed()")
