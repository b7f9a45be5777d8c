"""The sliding-window filter: its last steps are linearised anew at every scan, what is older is a Gaussian.

A filter linearises each scan once, when it knows least. Bearings alone suffer most: a landmark whose distance is still
open when it enters errs by that for ever. Here poses of the last steps stay unknowns beside the landmarks, and the
whole window is solved again with each scan (`advanced.window.kernels`). A pose that leaves it is eliminated where the
steps since have put it. With a window that holds everything this is the causal optimum; with ranges a few
steps are enough.

With bearings alone a landmark waits, with its bearings, until those of the window place it. A pose that leaves the
window with bearings of such a landmark stays, as an unknown beside the landmarks: nothing of what was seen is lost when
the robot comes back and sees the landmark again. There are half as many of these as the window holds at most; beyond
that the oldest goes. What a step costs does not grow with time.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.window import kernels as passes
from slamgauge.ekf.advanced.window import marginal_prior
from slamgauge.ekf.advanced.window.gauss_newton import NoMinimumError, descended, inverse, swept, symmetric
from slamgauge.ekf.advanced.window.observations import (
    NOTHING,
    Bearings,
    Scan,
    in_two_rows,
    joined,
    observed_by_pose,
    scan_of,
)
from slamgauge.ekf.advanced.window.warm_up import compile_window_once
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.prediction import is_semidefinite
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LARGEST, NO_MINIMUM
from slamgauge.ekf.maps.input_checks import (
    WHY,
    explain_increment,
    explain_scan,
    ids_of,
    load_increment,
    require_ids,
    require_sensor,
    rows_of,
    start_of,
)
from slamgauge.ekf.online_filter import PointFilter
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.se2 import compose, rotation
from slamgauge.sensor_kernels import locate_all
from slamgauge.sensors import MIN_BEARING_DISTANCE, SENSORS
from slamgauge.validation import require_lag

LAG = 100  # steps
KEPT = 0.5  # of so many poses may be kept for landmarks that wait
WAITING = -1  # slot of a landmark that has no place


class SlidingWindowFilter(PointFilter):
    """Landmark SLAM with known association whose last steps are linearised anew at every scan.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        lag: steps that are linearised anew. A step's time grows with it, and with the square of the landmarks and of
            the poses that are kept. With bearings alone a short one places landmarks too early: give some tens.

    Raises:
        UserError: a sensor that does not exist, an invalid prior, or no lag.
    """

    def __init__(self, sensor: str, prior_mean: ArrayLike, prior_cov: ArrayLike, lag: int = LAG) -> None:
        require_sensor(sensor, tuple(SENSORS))
        self._lag = require_lag(lag)
        compile_window_once()
        self._sensor = sensor
        self._origin, start, self._pose_cov = start_of(prior_mean, prior_cov)
        self._window = passes.Window(start[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3, 3)))
        self._scans: list[Scan] = [NOTHING]  # of the window's poses
        self._kept: list[Scan] = []  # of poses that have left it
        self._rest = np.zeros(0)  # landmarks (L, 2), then poses of `_kept` (K, 3)
        self._prior = marginal_prior.of_start(start, self._pose_cov)
        self._number_of: dict[int, int] = {}  # by id
        self._slot_of: Int = np.zeros(0, np.int64)  # by number
        self._ids: list[int] = []  # by slot
        self._placed_at: list[int] = []  # step, by slot
        self._step = 0
        self._associated: Int = np.zeros(0, np.int64)

    # --- what is believed ------------------------------------------------------------------------

    @property
    def pose(self) -> Float:
        """(3,) x, y [m], heading [rad] in the world frame."""
        pose = self._window.pose[-1].copy()
        pose[:2] += self._origin
        return pose

    @property
    def pose_cov(self) -> Float:
        """(3, 3) covariance of the additive pose error in the world frame."""
        return self._pose_cov.copy()

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids of the landmarks that have a place, in the order in which they got it."""
        return np.array(self._ids, dtype=np.int64)

    @property
    def landmarks(self) -> Float:
        """(L, 2) their positions [m] in the world frame."""
        return self._rest[: 2 * len(self._ids)].reshape(-1, 2) + self._origin

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) their covariances [m^2], linearised where the window stands now.

        Raises:
            UserError: double precision does not hold them.
        """
        if not self._ids:
            return np.zeros((0, 2, 2))
        with self._all_or_nothing("landmark_covs: there are none"):
            cov = inverse(symmetric(swept(self._problem()).A))
        block = ROBOT + np.arange(2 * len(self._ids)).reshape(-1, 2)
        return cov[block[:, :, None], block[:, None, :]]

    @property
    def provisional(self) -> dict[int, int]:
        """Landmarks that wait for a place; they have no members."""
        return {name: 0 for name, number in self._number_of.items() if self._slot_of[number] == WAITING}

    @property
    def kept_poses(self) -> Float:
        """(K, 3) poses that have left the window, and stay for landmarks that wait; as `pose`."""
        poses = self._rest[2 * len(self._ids) :].reshape(-1, 3).copy()
        poses[:, :2] += self._origin
        return poses

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations."""
        return self._associated.copy()

    def standing(self, ids: Int) -> Int:
        """What has become of ids given earlier: -1 for those of landmarks that bearings do not place."""
        return np.where(np.isin(ids, self.landmark_ids), ids, WAITING)

    # --- steps -----------------------------------------------------------------------------------

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: shapes that do not fit, a number that is not finite, no covariance, or no solution in double
                precision; the filter is unchanged.
        """
        move, move_cov = np.empty(3), np.empty((3, 3))
        load_increment(increment, cov, move, move_cov)
        believable = np.abs(move).max() < LARGEST and np.abs(move_cov).max() < LARGEST**2
        if not (believable and is_semidefinite(move_cov)):
            raise explain_increment(move, move_cov)
        if len(self._scans) > self._lag:
            with self._all_or_nothing("increment: no window is left without its first pose"):
                self._slide()
        last = self._window.pose[-1]
        pose = compose(last, move)
        F, G = np.eye(3), np.eye(3)
        F[:2, 2] = last[1] - pose[1], pose[0] - last[0]
        G[:2, :2] = rotation(last[2])
        self._pose_cov = F @ self._pose_cov @ F.T + G @ move_cov @ G.T
        squares, directions = np.linalg.eigh(move_cov)
        root = directions * np.sqrt(np.maximum(squares, 0.0))
        parts = zip(self._window, (pose, np.zeros(3), move, root), strict=True)
        self._window = passes.Window(*(np.concatenate([all_of_it, new[None]]) for all_of_it, new in parts))
        self._scans.append(NOTHING)
        self._step += 1
        self._associated = np.zeros(0, np.int64)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Take in all observations of one step, and solve the window anew.

        Returns:
            (0, 0): a window that is solved as a whole has no innovations.

        Raises:
            UserError: no ids, shapes that do not fit, a negative range, a number that is not finite, a covariance that
                is not positive definite, or no solution in double precision; the filter is then unchanged.
        """
        given, given_covs = rows_of(observations, SENSORS[self._sensor].dim)
        ids = ids_of(observations, len(given))
        require_ids(ids)
        values, covs = in_two_rows(given, given_covs)
        if not are_sound(self._code, values, covs):
            raise explain_scan(self._sensor, given, given_covs, np.nan, np.diagonal(self._pose_cov))
        if len(ids):
            with self._all_or_nothing("observation: no update exists for this scan"):
                self._update(ids, values, covs)
        self._associated = ids.copy()
        return 0.0, 0

    @contextmanager
    def _all_or_nothing(self, what: str) -> Generator[None]:
        """Leave the filter as it was if what is done within raises; what precision does not hold is said in a line."""
        before = {name: each.copy() if isinstance(each, list | dict) else each for name, each in vars(self).items()}
        try:
            with np.errstate(all="ignore"):
                yield
        except BaseException as reason:
            vars(self).update(before)
            if isinstance(reason, np.linalg.LinAlgError | NoMinimumError):
                why = WHY[NO_MINIMUM if isinstance(reason, NoMinimumError) else EXHAUSTED]
                raise UserError(f"{what}; {why}") from None
            raise

    def _update(self, ids: Int, values: Float, covs: Float) -> None:
        for name in ids.tolist():
            self._number_of.setdefault(name, len(self._number_of))
        unplaced = np.full(len(self._number_of) - len(self._slot_of), WAITING)
        self._slot_of = np.concatenate([self._slot_of, unplaced])
        numbers = np.array([self._number_of[name] for name in ids.tolist()])
        self._scans[-1] = joined([self._scans[-1], scan_of(self._code, numbers, values, covs)])
        places_landmarks = SENSORS[self._sensor].places_landmarks
        if places_landmarks:
            self._place_seen(ids, values)
        if (self._slot_of[numbers] != WAITING).any():
            self._solve()
        if not places_landmarks and self._place_waiting(ids):
            self._solve()

    def _place_seen(self, ids: Int, values: Float) -> None:
        """Give a place to new landmarks where ranges or positions (m, 2) put them.

        One at the sensor waits for another sight: there its direction says nothing.
        """
        deltas, _ = locate_all(self._code, values)
        pose = self._window.pose[-1]
        says = (np.hypot(*deltas.T) >= MIN_BEARING_DISTANCE) | (not SENSORS[self._sensor].has_bearing)
        for row in np.flatnonzero(says).tolist():
            self._place(int(ids[row]), pose[:2] + rotation(pose[2]) @ deltas[row])

    def _place_waiting(self, ids: Int) -> bool:
        """Give a place to landmarks of a scan that bearings of the window, or all there are, place; whether to any."""
        waiting = [name for name in ids.tolist() if self._slot_of[self._number_of[name]] == WAITING]
        if not waiting:
            return False
        in_window = Bearings.of(self._scans, self._window.pose)
        kept = Bearings.of(self._kept, self._rest[2 * len(self._ids) :].reshape(-1, 3))
        mapped = len(self._ids)
        for name in waiting:
            seen, before = (each.of_landmark(self._number_of[name]) for each in (in_window, kept))
            place = seen.place()
            if place is None and len(before.pose):
                place = before.with_those(seen).place()
            if place is not None:
                self._place(name, place)
        return len(self._ids) > mapped

    def _place(self, name: int, place: Float) -> None:
        """Make a landmark an unknown, unless it is one."""
        number, mapped = self._number_of[name], len(self._ids)
        if self._slot_of[number] != WAITING:
            return
        self._slot_of = self._slot_of.copy()
        self._slot_of[number] = mapped
        self._ids.append(name)
        self._placed_at.append(self._step)
        self._rest = np.insert(self._rest, 2 * mapped, place)
        self._prior = marginal_prior.with_landmark(self._prior, mapped, place)

    # --- the window ------------------------------------------------------------------------------

    @property
    def _code(self) -> int:
        return SENSORS[self._sensor].code

    def _problem(self, scans: list[Scan] | None = None) -> passes.Problem:
        """Where the window stands; with some of its scans, if only these are asked for."""
        scans = self._scans if scans is None else scans
        observed, kept = (observed_by_pose(self._code, each, self._slot_of) for each in (scans, self._kept))
        return passes.Problem(self._prior, self._window, observed, kept, self._rest, len(self._ids))

    def _solve(self) -> None:
        solved, self._pose_cov = descended(self._problem())
        self._window, self._rest, self._prior = solved.window, solved.rest, solved.prior

    def _slide(self) -> None:
        """Eliminate the first pose of the window, or keep it for the landmarks that wait with its bearings.

        Kept poses go when all that they have seen has had a place for as long as the window is.
        """
        first_step = self._step - len(self._scans) + 1
        for which in reversed(range(len(self._kept))):
            slots = self._slot_of[self._kept[which].number]
            if all(slot != WAITING and self._placed_at[slot] < first_step for slot in slots.tolist()):
                self._let_go(which)
        first = self._scans[0]
        waiting = first.rows(np.flatnonzero(self._slot_of[first.number] == WAITING))
        if not len(waiting.number):
            self._prior = marginal_prior.without_first(self._problem([first]))
        else:
            self._prior, self._rest = marginal_prior.with_first_kept(self._problem([first]))
            self._kept.append(waiting)
        self._window = passes.Window(*(each[1:] for each in self._window))
        del self._scans[0]
        if len(self._kept) > KEPT * self._lag:
            self._let_go(0)

    def _let_go(self, which: int) -> None:
        """Eliminate a kept pose; bearings with which landmarks still wait are lost."""
        self._prior, self._rest = marginal_prior.without_kept(self._problem([]), which)
        del self._kept[which]
