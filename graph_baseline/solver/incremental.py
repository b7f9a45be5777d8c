"""Incremental smoothing with chord steps (`chord_descent`): the optimum of the measurements up to each step.

The optimum is the path and the map with the smallest sum of squared whitened residuals. A chord step is a Newton step
with the exact gradient, but with matrices that were linearised at an earlier state.

Each step of the recording adds a scan, and moves the newest pose and the map by the linear system of all steps so far.
It neither moves older poses nor corrects the linearisation error. Chord steps over the whole path do both: they
converge to a point where the gradient of the exact cost is zero. They run at every scan up to SHORT poses. Later they
run when the expected error of the newest pose exceeds MAX_ERROR, or after MAX_SCANS scans. The expected error grows
with the squared corrections of the newest pose. If chord steps find no minimum, or if the cost and its increase both
fail chi-square tests, `multistart` searches for a minimum from several starts.

A bearing-only landmark is added when the path of the optimum and its bearings determine its position, and removed when
they no longer do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.problem.residuals import measured_of
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.active_landmarks import ActiveLandmarks
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.isotropic_surrogate import surrogate_start
from slamgauge.graph_baseline.solver.levenberg_marquardt import Minimum, damped_descent
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

SHORT = 100  # poses; up to this length chord steps run at every scan
MAX_SCANS = 64  # largest number of scans between two convergences
MAX_ERROR = 0.003  # largest expected error of the newest pose between two convergences [sigmas]
PATIENCE = 0.7  # smallest ratio of the expected error rates after and before a convergence
LOWER = 1.0 - 1e-6  # another minimum counts as lower if its squared residuals are below this share
NEXT_SEARCH = 1.2  # step of the next search, relative to the step of a failed one
NEXT_LOWER_SEARCH = 2.0  # the same for searches of a lower minimum


class MinimumSwitch(NamedTuple):
    """A switch to another minimum: its path (k+1, 3), and the ids (L,) of the landmarks that were active before."""

    path: Float
    landmark_ids: Int


class IncrementalOptimum:
    """The optimum of the first steps of a recording; `add_step` adds the next step.

    Args:
        recording: measurements with known association.

    Attributes:
        converged: whether the minimum was found at the last step.
        unconverged_steps: number of steps without a minimum; their poses are dead reckoning from the last minimum.
        switches: switches to another minimum so far.
    """

    def __init__(self, recording: Recording) -> None:
        compile_graphs_once()
        recording = self._recording = prepare(recording)
        self._measured = measured_of(recording)
        poses, landmarks = recording.steps + 1, len(recording.landmark_ids)
        self._state = allocate_state(poses, landmarks)
        self._mapped = ActiveLandmarks(recording, self._measured, self._state)
        self._descent = ChordDescent(self._measured, self._state, self._mapped)
        self._scans, self._squared_motion = 0, 0.0  # since the last convergence; motion in squared sigmas
        self._error_rate = np.inf  # error of the newest pose [sigmas] per squared motion
        self.converged = True
        self.unconverged_steps = 0
        self._next_search = self._next_lower_search = self._next_misfit_search = 0
        self._freedom = 0  # degrees of freedom of the last minimum
        self.switches: list[MinimumSwitch] = []

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
        """Add the next pose and its scan.

        After a failed search, poses and scans are only stored. The next search starts when the path is NEXT_SEARCH
        times as long.
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
        """Converge to the minimum of all measurements, and relinearise all poses there."""
        if self.converged:
            self._converge(relinearise=True)
        else:
            self._search()
        if not SENSORS[self._recording.sensor].places_landmarks:
            self._converge_with_placed_landmarks()
        self.converged = self.converged and self._descent.relinearise()

    def _add_scan(self) -> None:
        """Add the newest scan; take chord steps if the expected error is too large, or if many scans were added."""
        k, mapped = self._newest, len(self._mapped)
        if self._measured.first[k] == self._measured.first[k + 1]:
            self._descent.add_newest_pose()
            return
        self._mapped.map_scan(k)
        step = self._descent.add_newest_scan(mapped)
        if step is None:
            self._converge(relinearise=True)
        else:
            self._scans += 1
            self._squared_motion += float(np.max(np.square(step / self._descent.sigma)))
            if k <= SHORT or self._scans >= MAX_SCANS or self._squared_motion * self._error_rate > MAX_ERROR:
                self._converge()
        if not SENSORS[self._recording.sensor].places_landmarks:
            self._converge_with_placed_landmarks()

    def _converge_with_placed_landmarks(self) -> None:
        """Add and remove bearing-only landmarks until the minimum places exactly the active ones.

        This corresponds to `placed_minimum`. Each landmark is added at most once, because a search may remove it again.
        """
        if self.converged and self._newest >= self._next_search and self._may_map_more():
            self._search_more_landmarks()
        tried = set[int]()
        while self.converged and (placed := self._mapped.map_waiting(self._newest, tried)):
            tried |= placed
            self._mapped.recheck_all()
            self._converge(relinearise=True)
        if self._newest <= SHORT:
            self._mapped.recheck_all()
        if self.converged and self._mapped.remove_unplaced(self._newest):
            self._converge(relinearise=True)

    def _converge(self, *, relinearise: bool = False) -> None:
        """Go to the minimum of the exact cost by chord steps, else by damped steps after SHORT poses, else by a search.

        If all fail, path and map are the ones before the chord steps.
        """

        def chord_steps() -> bool:
            return (not relinearise or self._descent.relinearise()) and self._descent.converge()

        k, last, last_chi_square = self._newest, self.newest_pose(), self._descent.chi_square
        self.converged = self._descends(chord_steps) or (k > SHORT and self._descends(self._converge_damped))
        if self.converged:
            if self._is_cost_unlikely(last_chi_square):
                self._search_lower()
        elif k < self._next_misfit_search:
            self._next_search = self._next_misfit_search
        else:
            self._search()
        self._freedom = self._degrees_of_freedom()
        change = self.newest_pose() - last
        change[2] = wrap(change[2])
        error = float(np.max(np.abs(change) / self._descent.sigma))
        expected = PATIENCE * self._error_rate if np.isfinite(self._error_rate) else 0.0
        self._error_rate = max(error / max(self._squared_motion, 1e-6), expected)
        self._scans, self._squared_motion = 0, 0.0

    def _descends(self, descent: Callable[[], bool]) -> bool:
        """Run a descent; return whether it converged. If not, path and map are the ones before it."""
        k, count, state = self._newest, len(self._mapped), self._state
        start = state.poses[: k + 1].copy(), state.landmarks[:count].copy()
        converged = descent()
        if not converged:
            state.poses[: k + 1], state.landmarks[:count] = start
        return converged

    def _converge_damped(self) -> bool:
        """Take damped steps, then chord steps; return whether they converged.

        Damped steps need fewer iterations than a search. They converge where large odometry noise makes the predicted
        pose so uncertain that chord steps diverge.
        """
        k, order = self._newest, np.argsort(self.landmark_ids)
        part = self._recording.first(k)
        part = part.only(np.isin(part.landmark, self.landmark_ids))
        found = damped_descent(part, *self.path_and_map())
        self._state.poses[: k + 1], self._state.landmarks[order] = found.poses, found.landmarks
        return self._descent.relinearise() and self._descent.converge()

    def _is_cost_unlikely(self, last_chi_square: float) -> bool:
        """Return whether the squared residuals and their increase since the last minimum both fail chi-square tests."""
        freedom = self._degrees_of_freedom()
        if self._newest < self._next_lower_search or explained_by_noise(self._descent.chi_square, freedom):
            return False
        return not explained_by_noise(self._descent.chi_square - last_chi_square, max(freedom - self._freedom, 1))

    def _degrees_of_freedom(self) -> int:
        """Return the number of observed values of active landmarks, minus two for each of these landmarks."""
        taken = self._measured.slot[: self._measured.first[self._newest + 1]] >= 0
        return int(taken.sum()) * self._recording.observation.shape[1] - 2 * len(self._mapped)

    def _search(self) -> None:
        """Search for a minimum; a failure delays the next search."""
        found = self._search_result()
        self.converged = found is not None and self._move_to(*found)
        if not self.converged:
            self._next_search = int(NEXT_SEARCH * self._newest) + 1
        self._delay_searches()

    def _may_map_more(self) -> bool:
        """Return whether a search may activate more landmarks.

        This is so if no landmark is active, or if the path of dead reckoning places an inactive landmark of the newest
        scan. Dead reckoning is precise enough for this only up to SHORT poses.
        """
        if not len(self._mapped):
            return True
        if self._newest > SHORT:
            return False
        waiting = self._mapped.waiting_in_scan(self._newest)
        return bool(waiting) and self._mapped.any_placed(self._newest, waiting, self._dead_reckoned())

    def _search_more_landmarks(self) -> None:
        """Search for a minimum with more active landmarks; a failure delays the next search."""
        found = self._search_result()
        if found is not None and len(found[1].landmarks) > len(self._mapped):
            self.converged = self._move_to(*found)
        else:
            self._next_search = int(NEXT_SEARCH * self._newest) + 1

    def _search_lower(self) -> None:
        """Search for a lower minimum."""
        found = self._search_result()
        if found is not None and 2.0 * found[1].cost <= LOWER * self._descent.chi_square:
            self.converged = self._move_to(*found)
        self._delay_searches()

    def _delay_searches(self) -> None:
        """Delay the next searches if noise does not explain the cost.

        After SHORT poses this includes the searches after chord steps without a minimum, because data that contradict
        the model may have no smooth minimum.
        """
        if not explained_by_noise(self._descent.chi_square, self._degrees_of_freedom()):
            self._next_lower_search = int(NEXT_LOWER_SEARCH * self._newest) + 1
            if self._newest > SHORT:
                self._next_misfit_search = int(NEXT_SEARCH * self._newest) + 1

    def _search_result(self) -> tuple[Int, Minimum] | None:
        """Search from several starts; return association (M,), -1 for unused observations, and minimum, or None."""
        k = self._newest
        part, here = self._recording.first(k), self._state.poses[: k + 1].copy()

        def starts(part: Problem, path: Float) -> Iterator[Start]:
            yield lambda: descent_start(part, path)
            places_landmarks = SENSORS[part.sensor].places_landmarks
            yield lambda: surrogate_start(part) if places_landmarks else inflated_noise_start(part, path)
            yield lambda: descent_start(part, here)
            yield lambda: growing_start(part)

        try:
            return placed_minimum(part, self._dead_reckoned(), starts)
        except UndeterminedError:
            return None

    def _dead_reckoned(self) -> Float:
        """Return the path (k+1, 3) of dead reckoning."""
        return chain(self._recording.prior_mean, self._recording.odometry[: self._newest])

    def _move_to(self, taken: Int, found: Minimum) -> bool:
        """Go to the minimum of a search; return whether the linear system there determines all landmarks."""
        self.switches.append(MinimumSwitch(found.poses, self._mapped.ids))
        self._state.poses[: self._newest + 1] = found.poses
        self._mapped.set_mapped(self._newest, np.unique(taken[taken >= 0]), found.landmarks)
        self._mapped.recheck_all()
        self._descent.chi_square = 2.0 * found.cost
        return self._descent.relinearise()
