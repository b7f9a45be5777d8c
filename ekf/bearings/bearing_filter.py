"""The online filter for bearings alone: young landmarks are the initialisation's, points are a `SlamFilter`'s.

A landmark begins young, in the way of the chosen initialisation: as a ray of members (`rays`), in inverse depth
(`inverse_depth`), or waiting to be placed (`delayed`). What a scan sees of points corrects first, all at once; then the
young ones have their turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.bearings.delayed import Waiting
from slamgauge.ekf.bearings.inverse_depth import YoungDepths
from slamgauge.ekf.bearings.ray_association import RayAssociation
from slamgauge.ekf.bearings.rays import YoungRays
from slamgauge.ekf.bearings.young import POINT, Members, Young, joined
from slamgauge.ekf.filter import SOUND, Correction, SlamFilter
from slamgauge.ekf.kernels.compatibility import NONE
from slamgauge.ekf.kernels.warm_up import compile_association_once, compile_bearings_once
from slamgauge.ekf.settings.association import Association
from slamgauge.ekf.settings.initialisation import Initialisation, InverseDepth, Rays
from slamgauge.estimate import RayLog
from slamgauge.recording import Observations

NOBODY = -2  # owner of a slot that no bearing is compared with


class BearingFilter:
    """Online bearing-only SLAM.

    Args:
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `SlamFilter`.
        initialisation: how landmarks begin; as rays with their defaults if not given.
        association: how bearings find their landmarks; None where they have ids.

    Raises:
        ValueError: an association for landmarks that do not begin as rays.
    """

    def __init__(
        self,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction = "standard",
        initialisation: Initialisation | None = None,
        association: Association | None = None,
    ) -> None:
        initialisation = Rays() if initialisation is None else initialisation
        if association is not None and not isinstance(initialisation, Rays):
            raise ValueError("association: only rays can be associated; give ids, or initialise by ekf.Rays")
        compile_bearings_once()
        self._slam = SlamFilter("bearing", prior_mean, prior_cov, correction)
        self._young = _begin(self._slam, initialisation)
        self._points: dict[int, int] = {}  # landmark: its id in the filter
        self._step = 0
        self._association = None
        self._associated: Int = np.zeros(0, dtype=np.int64)
        if association is not None:
            compile_association_once()
            self._association = RayAssociation(association)

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        return self._slam.pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._slam.pose_cov

    @property
    def cov(self) -> Float:
        """(3 + 2n, 3 + 2n) covariance of the robot and everything else in the state."""
        return self._slam.cov

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks: points, and young ones of which something can be said."""
        return self._landmarks().landmark

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m]; of a ray that of its heaviest member."""
        return self._landmarks().position

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2]; of a ray that of its heaviest member."""
        return self._landmarks().cov

    @property
    def young(self) -> dict[int, int]:
        """Landmarks that are no points yet, and how many members each has."""
        return self._young.counts

    @property
    def member_count(self) -> int:
        """How many members the young landmarks have."""
        return sum(self._young.counts.values())

    @property
    def associated(self) -> Int:
        """(m,) id that each bearing of the current step was given, -1 if none."""
        return self._associated

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: -1 where the landmark is none any more, or not one yet."""
        return np.where(np.isin(ids, self.landmark_ids), ids, NONE)

    def ray_log(self, members: Int) -> RayLog | None:
        """What became of the rays, with the number of members (N+1,) after each step; None without rays."""
        return None if self._young.log is None else self._young.log.log(members)

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment; see `SlamFilter.predict`."""
        self._slam.predict(increment, cov)
        self._step += 1
        self._associated = self._associated[:0]

    def update(self, observations: Observations) -> tuple[float, int]:
        """Correct with the points' bearings of one step, then take in those of young and new landmarks.

        Returns:
            The normalised innovation squared of the points and its degrees of freedom.

        Raises:
            ValueError: no ids for a filter without association, shapes that do not fit, or an update that has no
                solution because a number is not finite or a variance not positive; the filter is then unchanged,
                unless it had diverged.
        """
        values, covs = np.asarray(observations.value), np.asarray(observations.cov)
        self._associated = self._associated[:0]
        if not len(values):
            return 0.0, 0
        if values.shape[1:] != (1,) or covs.shape != (len(values), 1, 1):
            raise ValueError(f"observation: shapes {values.shape}, {covs.shape} do not fit; give (m, 1), (m, 1, 1)")
        if not (np.isfinite(values).all() and np.isfinite(covs).all() and (covs > 0.0).all()):
            raise ValueError(f"observation: no update exists for this scan; {SOUND}")
        names = self._names(observations.landmark, values, covs)
        self._associated = names
        result = self._take_in(names.tolist(), values, covs)
        if self._association is not None:
            for name in self._association.false_starts({*self._young.counts, *self._points}):
                self._forget(name)
        return result

    def _names(self, ids: Int | None, values: Float, covs: Float) -> Int:
        if self._association is not None:
            return self._association.names(self._slam, self._owners(), values, covs)
        if ids is None:
            raise ValueError("landmark: this filter needs known association; give the ids of the observations")
        if len(ids) != len(values):
            raise ValueError(f"landmark: {len(ids)} ids for {len(values)} observations; give one for each")
        return np.asarray(ids)

    def _take_in(self, names: list[int], values: Float, covs: Float) -> tuple[float, int]:
        """Correct with the points' bearings, then give the young and new landmarks theirs; returns as `update`.

        Of a young landmark that is named more than once the first bearing is taken in; the others follow by themselves.
        """
        points = [row for row, name in enumerate(names) if name in self._points]
        slots = self._slam.slots_of(np.array([self._points[names[row]] for row in points], dtype=np.int64))
        nis, dof = self._slam.correct(slots, values[points], covs[points])
        others = [row for row, name in enumerate(names) if name not in self._points and name != NONE]
        first: dict[int, int] = {}
        for row in others:
            first.setdefault(names[row], row)
        rows = [*first.values()]
        self._points |= self._young.observe(self._step, [*first], values[rows], covs[rows])
        again = [row for row in others if first[names[row]] != row]
        if again:
            further = self._take_in([names[row] for row in again], values[again], covs[again])
            nis, dof = nis + further[0], dof + further[1]
        return nis, dof

    def _forget(self, name: int) -> None:
        """Take a landmark out of the state."""
        if name in self._points:
            self._slam.remove(int(self._slam.slots_of(np.array(self._points.pop(name)))))
        else:
            self._young.forget(self._step, name)

    def _owners(self) -> Int:
        """Landmark (n,) of each slot of the state."""
        owners = np.full(len(self._slam.landmark_ids), NOBODY)
        for name, member in self._points.items():
            owners[self._slam.slots_of(np.array(member))] = name
        for name, members in self._young.member_ids().items():
            owners[self._slam.slots_of(members)] = name
        return owners

    def _landmarks(self) -> Members:
        """A row for every landmark, points first; of equal members the nearest. Unconfirmed landmarks have none."""
        rows = self.whole_map()
        order = np.lexsort((-rows.number, rows.weight, rows.landmark))
        heaviest = order[np.diff(rows.landmark[order], append=NONE) != 0]
        if self._association is not None:
            confirmed = [self._association.is_confirmed(name) for name in rows.landmark[heaviest].tolist()]
            heaviest = heaviest[np.array(confirmed, dtype=bool)]
        heaviest.sort()
        landmark, number, weight = rows.landmark[heaviest], rows.number[heaviest], rows.weight[heaviest]
        return Members(landmark, number, weight, rows.position[heaviest], rows.cov[heaviest])

    def whole_map(self) -> Members:
        """Every point and every member of young landmarks."""
        slots = self._slam.slots_of(np.array([*self._points.values()], dtype=np.int64))
        count = len(slots)
        names = np.array([*self._points], dtype=np.int64)
        positions, covs = self._slam.landmarks[slots], self._slam.landmark_covs[slots]
        points = Members(names, np.full(count, POINT), np.ones(count), positions, covs)
        return joined([points, self._young.members()])


def _begin(slam: SlamFilter, initialisation: Initialisation) -> Young:
    if isinstance(initialisation, Rays):
        return YoungRays(slam, initialisation)
    if isinstance(initialisation, InverseDepth):
        return YoungDepths(slam, initialisation)
    return Waiting(slam, initialisation)
