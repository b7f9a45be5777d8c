"""Incremental smoothing with chord steps (`chord_descent`): the optimum of the measurements up to each step.

The optimum is the path and the map with the smallest sum of squared whitened residuals.

Each step of the recording adds a scan, and moves the newest pose and the map by the linear system of all steps so far.
It neither moves older poses nor corrects the linearisation error. Chord steps over the whole path do both: they
converge to a point where the gradient of the exact cost is zero. `Schedule` decides at which scans they run. If they
find no minimum, damped steps follow, then a search from dead reckoning and from the current path.

A bearing-only landmark is added when the path of the optimum and its bearings determine its position, and removed when
they no longer do.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import graph_arrays
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.active_landmarks import ActiveLandmarks, State
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.levenberg_marquardt import Minimum, damped_descent
from slamgauge.graph_baseline.solver.search import Start, explained_by_noise, placed_minimum
from slamgauge.recording import Recording
from slamgauge.se2 import compose, wrap
from slamgauge.sensors import SENSORS

SHORT = 100  # poses; up to this length chord steps run at every scan
MAX_SCANS = 64  # largest number of scans between two convergences
MAX_ERROR = 0.003  # largest expected error of the newest pose between two convergences [sigmas]
LOWEST_RATIO = 0.7  # smallest ratio of the expected error rates after and before a convergence
LOWER = 1.0 - 1e-6  # another minimum counts as lower if its squared residuals are below this share
NEXT_SEARCH = 1.2  # step of the next search, relative to the step of the last one


class Change(NamedTuple):
    """A change of minimum or map: the path (k+1, 3) after it, and the bearing-only landmarks (L,) active before."""

    path: Float
    landmark_ids: Int


class Schedule:
    """The scans at which chord steps run: when the expected error of the newest pose is too large.

    The error grows with the squared corrections of the newest pose since the last convergence, in squared sigmas. Each
    convergence measures how fast it grows.
    """

    def __init__(self) -> None:
        self._scans, self._squared_motion, self._error_rate = 0, 0.0, np.inf

    def add(self, step: Float) -> None:
        """Count a scan that corrected the newest pose by a step (3,) in sigmas."""
        self._scans += 1
        self._squared_motion += float(np.max(np.square(step)))

    def is_due(self, newest: int) -> bool:
        """Return whether chord steps are due at the newest pose."""
        error = self._squared_motion * self._error_rate
        return newest <= SHORT or self._scans >= MAX_SCANS or error > MAX_ERROR

    def restart(self, change: Float) -> None:
        """Begin again after a convergence that changed the newest pose by (3,) sigmas."""
        expected = LOWEST_RATIO * self._error_rate if np.isfinite(self._error_rate) else 0.0
        error = float(np.max(np.abs(change)))
        self._error_rate = max(error / max(self._squared_motion, 1e-6), expected)
        self._scans, self._squared_motion = 0, 0.0


class IncrementalOptimum:
    """The optimum of the first steps of a recording; `add_step` adds the next step.

    Args:
        recording: measurements with known association.

    Attributes:
        converged: whether the minimum was found at the last step.
        unconverged_steps: number of steps without a minimum; their poses are dead reckoning from the last minimum.
        changes: switches to another minimum so far, and in short bearing-only recordings changes of the map.
    """

    def __init__(self, recording: Recording) -> None:
        problem = self._problem = prepare(recording)
        self._places_landmarks = SENSORS[problem.sensor].places_landmarks
        self._arrays = graph_arrays(problem)
        self._arrays.slot[:] = -1
        self._state = State(np.zeros((problem.steps + 1, 3)), np.zeros((len(problem.landmark_ids), 2)))
        self._mapped = ActiveLandmarks(problem, self._arrays, self._state)
        self._descent = ChordDescent(self._arrays, self._state, self._mapped)
        self._schedule = Schedule()
        self._next_search = 0  # step before which no other search begins
        self._freedom = 0  # degrees of freedom of the last minimum
        self._has_switched = False  # to another minimum, since the last recorded change
        self.converged = True
        self.unconverged_steps = 0
        self.changes: list[Change] = []

    # --- results ---------------------------------------------------------------------------------

    @property
    def landmark_ids(self) -> Int:
        """(L,) ids in the order in which they became active."""
        return self._mapped.ids

    def newest_pose(self) -> Float:
        """Return x, y [m] and heading [rad] of the newest pose, (3,)."""
        return self._state.poses[self._newest].copy()

    def newest_cov(self) -> Float:
        """Return the covariance (3, 3) of the newest pose, world frame, from the current linear system."""
        return self._descent.newest_cov().copy()

    def landmarks(self) -> Float:
        """Return positions (L, 2) [m] in the order of `landmark_ids`."""
        return self._mapped.positions()

    def landmark_covs(self) -> Float:
        """Return the covariances (L, 2, 2) [m^2] in the order of `landmark_ids`."""
        return self._descent.landmark_covs()

    def path_and_map(self) -> tuple[Float, Float]:
        """Return smoothed poses (k+1, 3) [m, m, rad] and landmarks (L, 2) [m] in increasing id order."""
        return self._state.poses[: self._newest + 1].copy(), self.landmarks()[np.argsort(self.landmark_ids)]

    @property
    def _newest(self) -> int:
        return self._descent.newest

    # --- steps -----------------------------------------------------------------------------------

    def add_step(self) -> None:
        """Add the next pose and its scan. After a failed search they are only stored until the next search."""
        k, before = self._newest + 1, self._checked_ids()
        start = self._arrays.start
        self._descent.add_pose(compose(self._state.poses[k - 1], self._arrays.motion[k]) if k else start)
        if not self.converged:
            self._descent.add_newest_pose()
            if k >= self._next_search:
                self._search()
        else:
            self._add_scan()
        self.unconverged_steps += not self.converged
        self._record_change(before)

    def finish(self) -> None:
        """Converge to the minimum of all measurements, and relinearise all poses there."""
        before = self._checked_ids()
        if self.converged:
            self._converge(relinearise=True)
        else:
            self._search()
        if not self._places_landmarks:
            self._converge_with_placed_landmarks()
        self.converged = self.converged and self._descent.relinearise()
        self._record_change(before)

    def _checked_ids(self) -> Int:
        """Return the ids (L,) of the active landmarks of a bearing-only recording, whose changes are recorded."""
        return np.zeros(0, dtype=np.int64) if self._places_landmarks else self._mapped.ids

    def _record_change(self, before: Int) -> None:
        """Record a switch of minimum or, in a short recording, a change of the landmarks active `before` (L,)."""
        has_changed = self._problem.steps <= SHORT and not np.array_equal(before, self._checked_ids())
        if self._newest > 0 and (has_changed or self._has_switched):
            self.changes.append(Change(self._state.poses[: self._newest + 1].copy(), before))
        self._has_switched = False

    def _add_scan(self) -> None:
        """Add the newest scan; take chord steps if they are due."""
        k, mapped = self._newest, len(self._mapped)
        if self._arrays.first[k] == self._arrays.first[k + 1]:
            self._descent.add_newest_pose()
            return
        self._mapped.map_scan(k)
        step = self._descent.add_newest_scan(len(self._mapped) - mapped)
        if step is None:
            self._converge(relinearise=True)
        else:
            self._schedule.add(step / self._descent.sigma)
            if self._schedule.is_due(k):
                self._converge()
        if not self._places_landmarks:
            self._converge_with_placed_landmarks()

    def _converge_with_placed_landmarks(self) -> None:
        """Add and remove bearing-only landmarks until the minimum places exactly the active ones.

        This corresponds to `placed_minimum`. Each landmark is added at most once, because a search may remove it again.
        """
        if self.converged and self._newest >= self._next_search and self._may_map_more():
            self._search()
        tried = set[int]()
        while self.converged and (placed := self._mapped.map_waiting(self._newest, tried)):
            tried |= placed
            self._mapped.recheck_all()
            self._converge(relinearise=True)
        if self._newest <= SHORT:
            self._mapped.recheck_all()
        if self.converged and self._mapped.remove_unplaced(self._newest):
            self._converge(relinearise=True)

    def _may_map_more(self) -> bool:
        """Return whether a search may activate more landmarks.

        This is so if no landmark is active, or if the path of dead reckoning places an inactive landmark of the newest
        scan. Dead reckoning is precise enough for this only up to SHORT poses.
        """
        k = self._newest
        if not len(self._mapped):
            return True
        return k <= SHORT and self._mapped.may_place_waiting(k, self._problem.dead_reckoning)

    # --- descents and searches -------------------------------------------------------------------

    def _converge(self, *, relinearise: bool = False) -> None:
        """Go to the minimum of the exact cost by chord steps, else by damped steps, else by a search.

        If all fail, path and map are the ones before. If noise explains neither the cost at the minimum nor its
        increase, a search for a lower minimum follows.
        """
        last, last_chi_square, state = self.newest_pose(), self._descent.chi_square, self._copied_state()
        self.converged = (not relinearise or self._descent.relinearise()) and self._descent.converge()
        if not self.converged:
            self._restore(state)
            self.converged = self._converge_damped()
        if not self.converged:
            self._restore(state)
        freedom = self._degrees_of_freedom()
        if self._newest >= self._next_search and not (self.converged and self._is_explained(last_chi_square, freedom)):
            self._search()
        self._freedom = self._degrees_of_freedom()
        change = self.newest_pose() - last
        change[2] = wrap(change[2])
        self._schedule.restart(change / self._descent.sigma)

    def _copied_state(self) -> tuple[Float, Float]:
        return self._state.poses[: self._newest + 1].copy(), self._state.landmarks[: len(self._mapped)].copy()

    def _restore(self, state: tuple[Float, Float]) -> None:
        self._state.poses[: self._newest + 1], self._state.landmarks[: len(self._mapped)] = state

    def _converge_damped(self) -> bool:
        """Take damped steps, then chord steps; return whether they converged.

        They converge where large odometry noise makes the predicted pose so uncertain that chord steps diverge.
        """
        k, order = self._newest, np.argsort(self.landmark_ids)
        part = self._problem.first(k)
        part = part.only(np.isin(part.landmark, self.landmark_ids))
        found = damped_descent(Objective(part), *self.path_and_map())
        self._state.poses[: k + 1], self._state.landmarks[order] = found.poses, found.landmarks
        return self._descent.relinearise() and self._descent.converge()

    def _is_explained(self, last_chi_square: float, freedom: int) -> bool:
        """Return whether noise explains the squared residuals, or their increase since the last minimum."""
        added = self._descent.chi_square - last_chi_square, max(freedom - self._freedom, 1)
        return explained_by_noise(self._descent.chi_square, freedom) or explained_by_noise(*added)

    def _degrees_of_freedom(self) -> int:
        """Return the number of observed values of active landmarks, minus two for each of these landmarks."""
        taken = self._arrays.slot[: self._arrays.first[self._newest + 1]] >= 0
        return int(taken.sum()) * self._problem.observation.shape[1] - 2 * len(self._mapped)

    def _search(self) -> None:
        """Search for a minimum that is lower or has more landmarks, and go there; the next search is delayed."""
        self._next_search = int(NEXT_SEARCH * self._newest) + 1
        part, here = self._problem.first(self._newest), self._state.poses[: self._newest + 1].copy()

        def starts(part: Problem, path: Float) -> Iterator[Start]:
            yield lambda: (path, landmarks_at_median(part, path))
            yield lambda: (here, landmarks_at_median(part, here))

        try:
            taken, found = placed_minimum(part, part.dead_reckoning, starts)
        except UndeterminedError:
            return
        more = len(found.landmarks) - len(self._mapped)
        if not self.converged or more > 0 or (more == 0 and 2.0 * found.cost <= LOWER * self._descent.chi_square):
            self.converged = self._move_to(taken, found)

    def _move_to(self, taken: Int, found: Minimum) -> bool:
        """Go to the minimum of a search; return whether the linear system there determines all landmarks."""
        self._has_switched = True
        self._state.poses[: self._newest + 1] = found.poses
        self._mapped.set_mapped(self._newest, np.unique(taken[taken >= 0]), found.landmarks)
        self._mapped.recheck_all()
        self._descent.chi_square = 2.0 * found.cost
        return self._descent.relinearise()
