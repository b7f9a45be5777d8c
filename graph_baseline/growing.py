"""An optimum that grows pose by pose and stays exact: incremental smoothing with chord steps.

A step takes its scan in where the path and the map stand, and moves the newest pose and the map by the linear problem
that all steps so far have left (`chord`). What that misses is found by chord steps over the whole path: at once where
the newest pose moves by much of its standard deviation, else as often as it takes to keep what is missed small.
All is linearised anew where the observations' Jacobians have moved, or a chord step takes too little away.
"""

from __future__ import annotations

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_solve, solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.chord import (
    SENSORS,
    Chord,
    Linear,
    Measured,
    Place,
    move,
    multipliers,
    respond,
    take_in,
)
from slamgauge.graph_baseline.descent import descend
from slamgauge.graph_baseline.factors import prior_cov_in_body, require_known_landmarks
from slamgauge.graph_baseline.linearisation import inverse_cholesky
from slamgauge.graph_baseline.smoother import own_blocks_of_inverse
from slamgauge.graph_baseline.triangulation import triangulate_one
from slamgauge.graph_baseline.undetermined import UndeterminedError, undetermined_variable
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation

MISSED = 0.002  # sigmas of the newest pose that may be missed between two checks
LONGEST = 64  # scans between two checks
SHORT = 100  # poses: a path that is checked at every scan
PATIENCE = 0.7  # of what is expected to be missed remains expected after a check that missed less
SETTLED = 0.01  # sigmas of all that was observed: what a chord step may leave
TRUSTED_RATE = 0.2  # no chord step is taken to leave less of itself
SLOW = 0.6  # of a chord step is left for the next: linearise anew
STALE = 0.05  # relative change of the observations' Jacobians: linearise anew
MAX_STEPS = 12
PASSES = 2  # of the newest scan, the second linearised where the first has led


class GrowingOptimum:
    """The optimum of the first steps of a recording.

    Args:
        recording: known association.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._ids = require_known_landmarks(recording)
        poses, rows, landmarks = recording.steps + 1, len(recording.observation), len(np.unique(self._ids))
        dim = recording.observation.shape[1]
        self._measured = Measured(
            SENSORS[recording.sensor],
            np.array(recording.prior_mean, dtype=np.float64),
            np.concatenate([np.zeros((1, 3)), recording.odometry]),
            np.concatenate([prior_cov_in_body(recording)[None], recording.odometry_cov]),
            np.searchsorted(recording.observation_step, np.arange(poses + 1)),
            np.ascontiguousarray(recording.observation, dtype=np.float64),
            inverse_cholesky(recording.observation_cov),
            np.full(rows, -1),
        )
        self.place = Place(np.zeros((poses, 3)), np.zeros((landmarks, 2)))
        self._linear = Linear(
            Place(np.zeros((poses, 3)), np.zeros((landmarks, 2))),
            np.zeros((poses, 2)),
            *(np.zeros((poses, 3, 3)) for _ in range(3)),
            np.zeros((rows, dim, 3)),
            np.zeros((rows, dim, 2)),
            np.zeros((3, 2 * landmarks)),
            np.zeros((3, 3)),
            np.zeros((2 * landmarks, 2 * landmarks)),
            np.zeros(2 * landmarks),
            np.zeros(3),
        )
        self._chord = Chord(np.zeros((poses, 3)), np.zeros((landmarks, 2)), np.zeros((poses, 3)), np.zeros((poses, 3)))
        self._base = Place(np.zeros((poses, 3)), np.zeros((landmarks, 2)))
        self._slot: dict[int, int] = {}
        self._newest = -1
        self._factor = np.zeros((0, 0))
        self.settled = True  # whether the minimum was found when it was last looked for
        self._sigma = np.zeros(3)
        self._since_check, self._travel, self._bend = 0, 0.0, 1.0
        self.counts = {"chord": 0, "anew": 0, "descend": 0, "check": 0}

    # --- what has been found ---------------------------------------------------------------------

    @property
    def landmark_ids(self) -> Int:
        """(L,) in the order in which they were mapped."""
        return np.array(list(self._slot), dtype=np.int64)

    def newest_pose(self) -> Float:
        """(3,) x, y [m], heading [rad]."""
        return self.place.poses[self._newest].copy()

    def newest_cov(self) -> Float:
        """(3, 3) of the newest pose, world frame."""
        M = self._linear.M[:, : len(self._factor)]
        spread = solve_triangular(self._factor, M.T, lower=True, check_finite=False)
        cov = self._linear.newest_cov + spread.T @ spread
        return (cov + cov.T) / 2

    def landmarks(self) -> Float:
        """(L, 2) [m], in the order of `landmark_ids`."""
        return self.place.landmarks[: len(self._slot)].copy()

    def landmark_covs(self) -> Float:
        """(L, 2, 2) [m^2]."""
        return own_blocks_of_inverse(self._factor)

    def path_and_map(self) -> tuple[Float, Float]:
        """Smoothed poses (k+1, 3), and landmarks (L, 2) in increasing id order."""
        return self.place.poses[: self._newest + 1].copy(), self.landmarks()[np.argsort(self.landmark_ids)]

    # --- steps -----------------------------------------------------------------------------------

    def add_step(self) -> None:
        """Take in the next pose and its scan."""
        k = self._newest = self._newest + 1
        poses = self.place.poses
        poses[k] = compose(poses[k - 1], self._measured.motion[k]) if k else self._measured.start
        new = self._find_new_landmarks(k)
        at = self._linear.at
        at.poses[k] = poses[k]
        if self._recording.sensor == "bearing" and new:
            self._relinearise()
            self._settle()
            return
        self._before_new = len(self._slot) - new
        at.landmarks[self._before_new : len(self._slot)] = self.place.landmarks[self._before_new : len(self._slot)]
        if self._measured.first[k] == self._measured.first[k + 1]:
            take_in(self._measured, self._linear, self.place, self.place, len(self._slot), k, k + 1)
            return
        step = self._take_in_newest()
        self._since_check += 1
        self._travel += float(np.max(np.square(step / self._sigma)))
        if k <= SHORT or self._since_check >= LONGEST or self._travel * self._bend > MISSED:
            before = poses[k].copy()
            self._settle()
            missed = float(np.max(np.abs(poses[k] - before) / self._sigma))
            self._bend = max(missed / max(self._travel, 1e-6), PATIENCE * self._bend)
            self._since_check, self._travel = 0, 0.0

    def _take_in_newest(self) -> Float:
        """Take in the newest scan, linearised where it leads; the newest pose's step (3,)."""
        k, count, at, linear, place = self._newest, len(self._slot), self._linear.at, self._linear, self.place
        base = self._base
        base.poses[k], base.landmarks[:count] = place.poses[k], place.landmarks[:count]
        saved = linear.M.copy(), linear.newest_cov.copy(), linear.information[: 2 * count, : 2 * count].copy()
        seen_new = slice(self._before_new, count)
        for again in range(PASSES):
            if again:
                linear.M[:], linear.newest_cov[:], linear.information[: 2 * count, : 2 * count] = saved
                at.poses[k] = place.poses[k]
                at.landmarks[seen_new] = place.landmarks[seen_new]
            take_in(self._measured, linear, place, base, count, k, k + 1)
            self._factorise()
            landmarks = self._solve(linear.pull[: 2 * count])
            step = linear.kick + linear.M[:, : 2 * count] @ landmarks
            place.poses[k] = base.poses[k] + step
            place.landmarks[:count] = base.landmarks[:count] + landmarks.reshape(-1, 2)
        return step

    def finish(self) -> None:
        """Go to the minimum, all matrices taken there."""
        self._settle()
        self._relinearise()

    def _settle(self) -> None:
        """Go to the minimum of the exact cost: by chord steps, else by damped ones, else not at all."""
        self.counts["check"] += 1
        self.settled = True
        k, count = self._newest, len(self._slot)
        start = self.place.poses[: k + 1].copy(), self.place.landmarks[:count].copy()
        try:
            if self._converge():
                return
        except (UndeterminedError, LinAlgError):
            pass
        self.place.poses[: k + 1], self.place.landmarks[:count] = start
        try:
            self._descend()
        except UndeterminedError:
            self.settled = False

    def _converge(self) -> bool:
        """Whether chord steps come to rest, linearising anew where they take too little away."""
        before = np.inf
        for _ in range(MAX_STEPS):
            size, moved = self._chord_step()
            if not size < 2.0 * before:
                return False
            rate = size / before
            if size * max(rate, TRUSTED_RATE) < SETTLED:
                if moved > STALE:
                    self._relinearise()
                return True
            if rate > SLOW or moved > STALE:
                self._relinearise()
            before = size
        return False

    def _chord_step(self) -> tuple[float, float]:
        """Move by one; how far that moves what was observed, in sigmas, and the relative change of the Jacobians."""
        self.counts["chord"] += 1
        measured, linear, chord, k = self._measured, self._linear, self._chord, self._newest
        moved, norm = multipliers(measured, linear, self.place, k, chord)
        respond(measured, linear, k, False, chord)
        count = len(self._slot)
        chord.landmark[:count] = self._solve(chord.landmark[:count].ravel()).reshape(-1, 2)
        if count:
            respond(measured, linear, k, True, chord)
        size = move(measured, linear, self.place, k, count, chord)
        return size, float(np.sqrt(moved / max(norm, 1e-300)))

    def _relinearise(self) -> None:
        """Take in all poses again, linearised where path and map stand."""
        self.counts["anew"] += 1
        k, count, at = self._newest, len(self._slot), self._linear.at
        at.poses[: k + 1] = self.place.poses[: k + 1]
        at.landmarks[:count] = self.place.landmarks[:count]
        self._linear.information[: 2 * count, : 2 * count] = 0.0
        take_in(self._measured, self._linear, self.place, self.place, count, 0, k + 1)
        self._factorise()

    def _factorise(self) -> None:
        width = 2 * len(self._slot)
        try:
            self._factor = np.linalg.cholesky(self._linear.information[:width, :width])
        except LinAlgError:
            raise undetermined_variable("l", int(self.landmark_ids[0])) from None
        sigma = np.sqrt(np.diag(self.newest_cov()))
        self._sigma = np.where(sigma > 1e-9, sigma, np.inf)

    def _solve(self, right: Float) -> Float:
        return cho_solve((self._factor, True), right, check_finite=False) if len(right) else right

    def _find_new_landmarks(self, k: int) -> int:
        """Give slots to landmarks that are first seen, or first placed by bearings, at pose k; their number."""
        first, last = self._measured.first[k], self._measured.first[k + 1]
        before = len(self._slot)
        for row in range(first, last):
            name = int(self._ids[row])
            if name in self._slot:
                self._measured.slot[row] = self._slot[name]
                continue
            landmark = self._landmark_at_first_sight(name, row)
            if landmark is None:
                continue
            slot = self._slot[name] = len(self._slot)
            self._measured.slot[:last][self._ids[:last] == name] = slot
            self.place.landmarks[slot] = landmark
        return len(self._slot) - before

    def _landmark_at_first_sight(self, name: int, row: int) -> Float | None:
        """(2,) in the world, from the newest pose; None for one that its bearings do not place."""
        z, pose = self._recording.observation[row], self.place.poses[self._newest]
        if self._recording.sensor == "bearing":
            rows = np.flatnonzero(self._ids[: row + 1] == name)
            landmark, sigma = triangulate_one(self._recording, rows, self.place.poses)
            return landmark if np.isfinite(sigma) else None
        body = z if self._recording.sensor == "position" else z[0] * np.array([np.cos(z[1]), np.sin(z[1])])
        return pose[:2] + rotation(pose[2]) @ body

    def _descend(self) -> None:
        """Search the minimum from here by damped steps."""
        self.counts["descend"] += 1
        k, ids = self._newest, self.landmark_ids
        part = self._recording.first(k)
        part = part.only(self._measured.slot[: len(part.observation)] >= 0)
        order = np.argsort(ids)
        found = descend(part, ids[order], self.place.poses[: k + 1], self.place.landmarks[order])
        self.place.poses[: k + 1] = found.poses
        self.place.landmarks[order] = found.landmarks
        self._relinearise()
