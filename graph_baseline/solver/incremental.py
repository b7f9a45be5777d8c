"""An optimum that grows pose by pose and stays one: incremental smoothing with chord steps (`chord_descent`).

A step takes its scan in and moves the newest pose and the map by the linear problem that all steps so far have left.
The rest of the path stays behind, and what the linear problem misses is not seen. Both are mended by chord steps over
the whole path, which end where the gradient of the exact cost is zero: at every scan while the path is short, later as
often as it takes to keep small what is missed, which grows with the square of how far the newest pose is moved. A
minimum that they do not find is sought from several starts (`search`), and so is a lower one where the cost has risen
by more than noise explains.

Of bearings alone, landmarks wait until the optimum places them, and leave where it no longer does.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.problem.residuals import measured_of
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.active_landmarks import ActiveLandmarks
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.levenberg_marquardt import Minimum
from slamgauge.graph_baseline.solver.linear_problem import allocate_state
from slamgauge.graph_baseline.solver.multistart import (
    Start,
    descent_start,
    explained_by_noise,
    growing_start,
    inflated_noise_start,
    placed_minimum,
)
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once
from slamgauge.recording import Recording
from slamgauge.se2 import chain, compose, wrap
from slamgauge.sensors import SENSORS

SHORT = 100  # poses of a path that is settled at every scan
MAX_SCANS = 64  # scans between two settlings
MAX_ERROR = 0.003  # sigmas of the newest pose that may be missed between them
PATIENCE = 0.7  # of what is expected to be missed remains expected after a settling that found less
LOWER = 1.0 - 1e-6  # of the squared residuals: another minimum
NEXT_SEARCH = 1.2  # times the steps at which no minimum, or none that is lower, was found: look again
NEXT_LOWER_SEARCH = 2.0  # the same for a lower one of a path that is not short


class MinimumSwitch(NamedTuple):
    """Where a search has led: a path (k+1, 3), and the landmarks (L,) that were mapped before."""

    path: Float
    landmark_ids: Int


class IncrementalOptimum:
    """The optimum of the first steps of a recording.

    Args:
        recording: known association.
    """

    def __init__(self, recording: Recording) -> None:
        compile_graphs_once()
        recording = self._recording = prepare(recording)
        self._measured = measured_of(recording)
        poses, landmarks = recording.steps + 1, len(recording.landmark_ids)
        self._state = allocate_state(poses, landmarks)
        self._mapped = ActiveLandmarks(recording, self._measured, self._state)
        self._descent = ChordDescent(self._measured, self._state, self._mapped)
        self._scans, self._squared_motion = 0, 0.0  # since the last settling; travel in squared sigmas
        self._error_rate = np.inf  # sigmas missed for each of travel
        self.converged = True  # whether the minimum was found when it was last looked for
        self.unconverged_steps = 0  # steps without: their pose is dead reckoning from the last that had one
        self._next_search = self._next_lower_search = 0
        self._freedom = 0  # of the last minimum
        self.switches: list[MinimumSwitch] = []

    # --- what has been found ---------------------------------------------------------------------

    @property
    def landmark_ids(self) -> Int:
        """(L,) in the order in which they were mapped."""
        return self._mapped.ids

    def newest_pose(self) -> Float:
        """(3,) x, y [m], heading [rad]."""
        return self._state.poses[self._newest].copy()

    def newest_cov(self) -> Float:
        """(3, 3) of the newest pose, world frame, by the matrices at hand; while unsettled, of what they are about."""
        return self._descent.newest_cov().copy()

    def landmarks(self) -> Float:
        """(L, 2) [m], in the order of `landmark_ids`."""
        return self._mapped.positions()

    def landmark_covs(self) -> Float:
        """(L, 2, 2) [m^2]."""
        return self._descent.landmark_covs()

    def path_and_map(self) -> tuple[Float, Float]:
        """Smoothed poses (k+1, 3), and landmarks (L, 2) in increasing id order."""
        return self._state.poses[: self._newest + 1].copy(), self.landmarks()[np.argsort(self.landmark_ids)]

    @property
    def _newest(self) -> int:
        return self._descent.newest

    # --- steps -----------------------------------------------------------------------------------

    def add_step(self) -> None:
        """Take in the next pose and its scan.

        Where there is no minimum, scans wait: one is sought again when the path has become longer by a fifth.
        """
        k = self._newest + 1
        last = self._state.poses[k - 1]
        self._descent.add_pose(compose(last, self._measured.motion[k]) if k else self._measured.start)
        if not self.converged:
            self._descent.add_newest_pose()
            if k >= self._next_search:
                self._search()
        else:
            self._add_scan()
        self.unconverged_steps += not self.converged

    def finish(self) -> None:
        """Go to the minimum, with all matrices taken there."""
        if self.converged:
            self._converge(anew=True)
        else:
            self._search()
        if not SENSORS[self._recording.sensor].places_landmarks:
            self._converge_with_placed_landmarks()
        self.converged = self.converged and self._descent.relinearise()

    def _add_scan(self) -> None:
        """Take in the newest scan, and settle if it is time to."""
        k, mapped = self._newest, len(self._mapped)
        if self._measured.first[k] == self._measured.first[k + 1]:
            self._descent.add_newest_pose()
            return
        self._mapped.map_scan(k)
        step = self._descent.add_newest_scan(mapped)
        if step is None:
            self._converge(anew=True)
        else:
            self._scans += 1
            self._squared_motion += float(np.max(np.square(step / self._descent.sigma)))
            if k <= SHORT or self._scans >= MAX_SCANS or self._squared_motion * self._error_rate > MAX_ERROR:
                self._converge()
        if not SENSORS[self._recording.sensor].places_landmarks:
            self._converge_with_placed_landmarks()

    def _converge_with_placed_landmarks(self) -> None:
        """Go to the minimum of the landmarks that bearings place from there, as `placed_minimum` does.

        Each is taken in once at most: a search may leave it out again.
        """
        if self.converged and self._newest >= self._next_search and self._may_map_more():
            self._search_more_landmarks()
        taken_in = set[int]()
        while self.converged and (placed := self._mapped.map_waiting(self._newest, taken_in)):
            taken_in |= placed
            self._mapped.recheck_all()
            self._converge(anew=True)
        if self._newest <= SHORT:
            self._mapped.recheck_all()
        if self.converged and self._mapped.remove_unplaced(self._newest):
            self._converge(anew=True)

    def _converge(self, *, anew: bool = False) -> None:
        """Go to the minimum of the exact cost, by chord steps or else by a search; stay where neither finds it."""
        k, count, state = self._newest, len(self._mapped), self._state
        start = state.poses[: k + 1].copy(), state.landmarks[:count].copy()
        last_chi_square = self._descent.chi_square
        self.converged = (not anew or self._descent.relinearise()) and self._descent.converge()
        if not self.converged:
            state.poses[: k + 1], state.landmarks[:count] = start
            self._search()
        elif self._is_cost_unlikely(last_chi_square):
            self._search_lower()
        self._freedom = self._degrees_of_freedom()
        apart = state.poses[k] - start[0][k]
        apart[2] = wrap(apart[2])
        missed = float(np.max(np.abs(apart) / self._descent.sigma))
        expected = PATIENCE * self._error_rate if np.isfinite(self._error_rate) else 0.0
        self._error_rate = max(missed / max(self._squared_motion, 1e-6), expected)
        self._scans, self._squared_motion = 0, 0.0

    def _is_cost_unlikely(self, last_chi_square: float) -> bool:
        """Whether noise explains neither all squared residuals nor those that came since the last minimum."""
        freedom = self._degrees_of_freedom()
        if self._newest < self._next_lower_search or explained_by_noise(self._descent.chi_square, freedom):
            return False
        return not explained_by_noise(self._descent.chi_square - last_chi_square, max(freedom - self._freedom, 1))

    def _degrees_of_freedom(self) -> int:
        """Rows of what has been taken in, less the unknowns of its landmarks."""
        taken = self._measured.slot[: self._measured.first[self._newest + 1]] >= 0
        return int(taken.sum()) * self._recording.observation.shape[1] - 2 * len(self._mapped)

    def _search(self) -> None:
        """Search a minimum; where there is none, leave it for a while."""
        found = self._search_result()
        self.converged = found is not None and self._move_to(*found)
        if not self.converged:
            self._next_search = int(NEXT_SEARCH * self._newest) + 1

    def _may_map_more(self) -> bool:
        """Whether nothing is mapped, or dead reckoning places a landmark of the newest scan that waits.

        Dead reckoning tells as much as long as the path is short.
        """
        if not len(self._mapped):
            return True
        if self._newest > SHORT:
            return False
        waiting = self._mapped.waiting_in_scan(self._newest)
        return bool(waiting) and self._mapped.any_placed(self._newest, waiting, self._dead_reckoned())

    def _search_more_landmarks(self) -> None:
        """Search a minimum with more landmarks than the present one has; where there is none, leave it for a while."""
        found = self._search_result()
        if found is not None and len(found[1].landmarks) > len(self._mapped):
            self.converged = self._move_to(*found)
        else:
            self._next_search = int(NEXT_SEARCH * self._newest) + 1

    def _search_lower(self) -> None:
        """Search a minimum that is lower than the present one; where there is none, leave it for a while."""
        found = self._search_result()
        if found is None or 2.0 * found[1].cost > LOWER * self._descent.chi_square:
            again = NEXT_SEARCH if self._newest <= SHORT else NEXT_LOWER_SEARCH
            self._next_lower_search = int(again * self._newest) + 1
        else:
            self.converged = self._move_to(*found)

    def _search_result(self) -> tuple[Int, Minimum] | None:
        """Which landmark each observation is of, -1 for none, and a minimum sought without the present one, if any."""
        k = self._newest
        part, here = self._recording.first(k), self._state.poses[: k + 1].copy()

        def starts(part: Problem, path: Float) -> Iterator[Start]:
            yield lambda: descent_start(part, path)
            yield lambda: inflated_noise_start(part, path)
            yield lambda: descent_start(part, here)
            yield lambda: growing_start(part)

        try:
            return placed_minimum(part, self._dead_reckoned(), starts)
        except UndeterminedError:
            return None

    def _dead_reckoned(self) -> Float:
        """Path (k+1, 3) of the odometry alone."""
        return chain(self._recording.prior_mean, self._recording.odometry[: self._newest])

    def _move_to(self, taken: Int, found: Minimum) -> bool:
        """Go to a minimum that a search has found; whether its matrices determine all landmarks."""
        self.switches.append(MinimumSwitch(found.poses, self._mapped.ids))
        self._state.poses[: self._newest + 1] = found.poses
        self._mapped.set_mapped(self._newest, np.unique(taken[taken >= 0]), found.landmarks)
        self._mapped.recheck_all()
        self._descent.chi_square = 2.0 * found.cost
        return self._descent.relinearise()
