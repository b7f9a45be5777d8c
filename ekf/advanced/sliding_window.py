"""The sliding-window filter: the last steps are relinearised at every scan; older ones are a Gaussian prior.

An EKF linearises each scan once, at its least accurate estimate. The error is largest in bearing-only SLAM, where a
landmark may enter the state with a very uncertain distance. Here the poses of the last steps remain unknowns, like the
landmarks, and every scan solves the whole window again (`advanced.window.passes`). A pose that leaves the window is
marginalised at its present estimate. If the window contains all steps, the result is the causal optimum; with ranges a
few steps are enough.

A bearing-only landmark waits until the bearings in the window triangulate it. If a pose with bearings of a waiting
landmark leaves the window, it is kept as an unknown, so that these bearings are used when the landmark is re-observed.
At most half as many poses are kept as the window contains; then the oldest is marginalised. The cost of a step does
not grow with time.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float, Int
from slamgauge.ekf.advanced.window import marginal_prior
from slamgauge.ekf.advanced.window.cost import Problem, Window
from slamgauge.ekf.advanced.window.gauss_newton import NoMinimumError, forward_pass, inverse, minimise, symmetric
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
KEPT = 0.5  # largest number of kept poses, relative to the length of the window
WAITING = -1  # slot of a landmark that is not triangulated yet


class SlidingWindowFilter(PointFilter):
    """Landmark SLAM with known association that relinearises its last steps at every scan.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) covariance of the start pose; may be zero.
        lag: length of the window in steps. The time of a step is proportional to it, and to the square of the number of
            landmarks and kept poses. A bearing-only sensor needs several tens; a shorter window places landmarks badly.

    Raises:
        UserError: an invalid sensor, prior or lag.
    """

    def __init__(self, sensor: str, prior_mean: ArrayLike, prior_cov: ArrayLike, lag: int = LAG) -> None:
        require_sensor(sensor, tuple(SENSORS))
        self._lag = require_lag(lag)
        compile_window_once()
        self._sensor = sensor
        self._origin, start, self._pose_cov = start_of(prior_mean, prior_cov)
        self._window = Window(start[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3, 3)))
        self._scans: list[Scan] = [NOTHING]  # scans of the window's poses
        self._kept: list[Scan] = []  # scans of kept poses
        self._rest = np.zeros(0)  # landmarks (L, 2), then poses of `_kept` (K, 3)
        self._prior = marginal_prior.of_start(start, self._pose_cov)
        self._number_of: dict[int, int] = {}  # number of a landmark by its id
        self._slot_of: Int = np.zeros(0, np.int64)  # slot by number
        self._ids: list[int] = []  # id by slot
        self._placed_at: list[int] = []  # step of triangulation by slot
        self._step = 0
        self._associated: Int = np.zeros(0, np.int64)

    # --- estimate --------------------------------------------------------------------------------

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
        """(L,) ids of the mapped landmarks, in the order in which they were mapped."""
        return np.array(self._ids, dtype=np.int64)

    @property
    def landmarks(self) -> Float:
        """(L, 2) landmark positions [m] in the world frame."""
        return self._rest[: 2 * len(self._ids)].reshape(-1, 2) + self._origin

    @property
    def landmark_covs(self) -> Float:
        """(L, 2, 2) landmark covariances [m^2], linearised at the present estimate.

        Raises:
            UserError: double precision is not sufficient for them.
        """
        if not self._ids:
            return np.zeros((0, 2, 2))
        with self._rollback_on_error("landmark_covs: cannot be computed"):
            cov = inverse(symmetric(forward_pass(self._problem()).A))
        block = ROBOT + np.arange(2 * len(self._ids)).reshape(-1, 2)
        return cov[block[:, :, None], block[:, None, :]]

    @property
    def provisional(self) -> dict[int, int]:
        """Ids of waiting landmarks, with 0 members each."""
        return {name: 0 for name, number in self._number_of.items() if self._slot_of[number] == WAITING}

    @property
    def kept_poses(self) -> Float:
        """(K, 3) poses that are kept for waiting landmarks after they left the window; world frame."""
        poses = self._rest[2 * len(self._ids) :].reshape(-1, 3).copy()
        poses[:, :2] += self._origin
        return poses

    @property
    def associated(self) -> Int:
        """(m,) ids of the current step's observations."""
        return self._associated.copy()

    def standing(self, ids: Int) -> Int:
        """Return the ids (m,) of earlier observations with -1 for landmarks that still wait."""
        return np.where(np.isin(ids, self.landmark_ids), ids, WAITING)

    # --- steps -----------------------------------------------------------------------------------

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: invalid shapes, numbers that are not finite, an invalid covariance, or no solution in double
                precision; the filter is unchanged.
        """
        move, move_cov = np.empty(3), np.empty((3, 3))
        load_increment(increment, cov, move, move_cov)
        is_valid = np.abs(move).max() < LARGEST and np.abs(move_cov).max() < LARGEST**2
        if not (is_valid and is_semidefinite(move_cov)):
            raise explain_increment(move, move_cov)
        if len(self._scans) > self._lag:
            with self._rollback_on_error("increment: cannot marginalise the window's first pose"):
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
        self._window = Window(*(np.concatenate([all_of_it, new[None]]) for all_of_it, new in parts))
        self._scans.append(NOTHING)
        self._step += 1
        self._associated = np.zeros(0, np.int64)

    def update(self, observations: Observations) -> tuple[float, int]:
        """Add all observations of one step and solve the window again.

        Returns:
            (0, 0), because a window that is solved as a whole has no innovations.

        Raises:
            UserError: no ids, invalid shapes, a negative range, a number that is not finite, a covariance that is not
                positive definite, or no solution in double precision; the filter is then unchanged.
        """
        given, given_covs = rows_of(observations, SENSORS[self._sensor].dim)
        ids = ids_of(observations, len(given))
        require_ids(ids)
        values, covs = in_two_rows(given, given_covs)
        if not are_sound(self._code, values, covs):
            raise explain_scan(self._sensor, given, given_covs, np.nan, np.diagonal(self._pose_cov))
        if len(ids):
            with self._rollback_on_error("observation: no update exists for this scan"):
                self._update(ids, values, covs)
        self._associated = ids.copy()
        return 0.0, 0

    @contextmanager
    def _rollback_on_error(self, problem: str) -> Generator[None]:
        """Restore the filter if the body raises; turn a failed solution into a UserError that names the `problem`."""
        before = {name: each.copy() if isinstance(each, list | dict) else each for name, each in vars(self).items()}
        try:
            with np.errstate(all="ignore"):
                yield
        except BaseException as reason:
            vars(self).update(before)
            if isinstance(reason, np.linalg.LinAlgError | NoMinimumError):
                why = WHY[NO_MINIMUM if isinstance(reason, NoMinimumError) else EXHAUSTED]
                raise UserError(f"{problem}; {why}") from None
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
        """Map new landmarks at their observations (m, 2), which have ranges or positions.

        A landmark very close to the sensor waits for another observation, because its bearing has no information.
        """
        deltas, _ = locate_all(self._code, values)
        pose = self._window.pose[-1]
        is_informative = (np.hypot(*deltas.T) >= MIN_BEARING_DISTANCE) | (not SENSORS[self._sensor].has_bearing)
        for row in np.flatnonzero(is_informative).tolist():
            self._place(int(ids[row]), pose[:2] + rotation(pose[2]) @ deltas[row])

    def _place_waiting(self, ids: Int) -> bool:
        """Map waiting landmarks of a scan that their bearings triangulate; return whether any landmark was mapped.

        The bearings of the window are tried first, then these together with those of kept poses.
        """
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
                place = before.joined_with(seen).place()
            if place is not None:
                self._place(name, place)
        return len(self._ids) > mapped

    def _place(self, name: int, place: Float) -> None:
        """Map a landmark at `place` (2,), unless it is mapped."""
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

    def _problem(self, scans: list[Scan] | None = None) -> Problem:
        """Return the present problem, with the given scans or all scans of the window."""
        scans = self._scans if scans is None else scans
        observed, kept = (observed_by_pose(self._code, each, self._slot_of) for each in (scans, self._kept))
        return Problem(self._prior, self._window, observed, kept, self._rest, len(self._ids))

    def _solve(self) -> None:
        solved, self._pose_cov = minimise(self._problem())
        self._window, self._rest, self._prior = solved.window, solved.rest, solved.prior

    def _slide(self) -> None:
        """Marginalise the first pose of the window, or keep it if landmarks wait with its bearings.

        A kept pose is marginalised when all its landmarks have been mapped for the length of the window.
        """
        first_step = self._step - len(self._scans) + 1
        for which in reversed(range(len(self._kept))):
            slots = self._slot_of[self._kept[which].number]
            if all(slot != WAITING and self._placed_at[slot] < first_step for slot in slots.tolist()):
                self._marginalise_kept(which)
        first = self._scans[0]
        waiting = first.rows(np.flatnonzero(self._slot_of[first.number] == WAITING))
        if not len(waiting.number):
            self._prior = marginal_prior.without_first(self._problem([first]))
        else:
            self._prior, self._rest = marginal_prior.with_first_kept(self._problem([first]))
            self._kept.append(waiting)
        self._window = Window(*(each[1:] for each in self._window))
        del self._scans[0]
        if len(self._kept) > KEPT * self._lag:
            self._marginalise_kept(0)

    def _marginalise_kept(self, which: int) -> None:
        """Marginalise a kept pose; its bearings of waiting landmarks are lost."""
        self._prior, self._rest = marginal_prior.without_kept(self._problem([]), which)
        del self._kept[which]
