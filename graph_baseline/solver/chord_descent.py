"""Path and map of an optimum that grows pose by pose, with their matrices: down to the minimum by chord steps.

Matrices (`elimination`) stay as they were when a pose was taken in; chord steps (`chord`) lead to where the gradient of
the exact cost is zero all the same. Where they take too little away, all is linearised anew. For a large map that costs
as much as many steps: there they are mixed (`mixing`), so that they shrink, and so are those of any map once they have
called for that.
"""

from __future__ import annotations

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import get_lapack_funcs

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.residuals import Measured
from slamgauge.graph_baseline.solver import chord_kernels, linear_problem, pose_elimination
from slamgauge.graph_baseline.solver.active_landmarks import ActiveLandmarks
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration
from slamgauge.graph_baseline.solver.linear_problem import State
from slamgauge.graph_baseline.solver.multifrontal import EXHAUSTED
from slamgauge.graph_baseline.solver.smoother import own_blocks_of_inverse

factorise, solved = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)

CONVERGED = 0.003  # sigmas of the newest pose, and of all that was observed: what a chord step may leave
RATE = 0.2  # no chord step is trusted to leave less of itself
SLOW = 0.6  # of a chord step is left for the next, or of a mixed one for the next but one: linearise anew
STALE = 0.1  # relative change of Jacobians times reach: linearise anew
LARGE = 100  # landmarks: from so many on a few mixed steps cost less than to linearise anew
GROWN = 10.0  # times the smallest: chord steps lead away
MAX_STEPS = 20
PASSES = 2  # of the newest scan, the second linearised where the first has led
EXACT = 1e-9  # m or rad: a smaller standard deviation measures nothing


class ChordDescent:
    """Where path and map stand, and what has been taken in about them.

    Args:
        measured: known association.
        place: where poses and landmarks stand; it is moved here.
        mapped: the landmarks in use.

    Attributes:
        newest: number of the newest pose; -1 before the first.
        sigma: (3,) of the newest pose when the landmarks' information was factorised last; infinite what is exact.
        chi_square: sum of squared residuals, where a chord step was taken last.
    """

    def __init__(self, measured: Measured, state: State, mapped: ActiveLandmarks) -> None:
        self._measured, self._state, self._mapped = measured, state, mapped
        sizes = len(state.poses), len(state.landmarks), *measured.value.shape
        self._linear = linear_problem.allocate_linear(*sizes)
        self._before = linear_problem.allocate_state(*sizes[:2])  # the newest scan
        self._step = chord_kernels.allocate_chord(*sizes)
        self._mixing: AndersonAcceleration | None = (
            None  # of the chord steps since all was linearised, where they are mixed
        )
        self._sizes: list[float] = []  # of the same steps
        self._factor: Float = np.zeros((0, 0))  # (2L, 2L) lower triangular, of the landmarks' information
        self._newest_cov: Float | None = None  # unless it has been asked for
        self.newest = -1
        self.sigma = np.full(3, np.inf)
        self.chi_square = 0.0

    def add_pose(self, pose: Float) -> None:
        """Begin a step: the newest pose (3,) is expected here."""
        self.newest += 1
        self._state.poses[self.newest] = self._linear.at.poses[self.newest] = pose

    def newest_cov(self) -> Float:
        """(3, 3) of the newest pose, world frame, by the matrices at hand; while unsettled, of what they are about."""
        if self._newest_cov is None:
            cov = np.empty((3, 3))
            pose_elimination.newest_covariance(self._linear, self._factor, cov)
            self._newest_cov = (cov + cov.T) / 2
        return self._newest_cov

    def landmark_covs(self) -> Float:
        """(L, 2, 2) [m^2]."""
        return own_blocks_of_inverse(self._factor)

    def add_newest_scan(self, mapped: int) -> Float | None:
        """Take in the newest scan, linearised where it leads; the last landmarks, from number `mapped` on, are new.

        Returns by how much the newest pose (3,) has moved; None where the matrices do not determine all landmarks.
        """
        k, count, state, linear, before = self.newest, len(self._mapped), self._state, self._linear, self._before
        before.poses[k], before.landmarks[:count] = state.poses[k], state.landmarks[:count]
        linear.at.landmarks[mapped:count] = state.landmarks[mapped:count]
        information = linear.information[: 2 * count, : 2 * count]
        saved = linear.M.copy(), linear.newest_cov.copy(), information.copy()
        step = np.zeros(3)
        for again in range(PASSES):
            if again:
                linear.M[:], linear.newest_cov[:], information[:] = saved
                linear.at.poses[k] = state.poses[k]
                linear.at.landmarks[mapped:count] = state.landmarks[mapped:count]
            if not (self._eliminate_poses(before, k) and self._factorise()):
                return None
            landmarks = self._solve(linear.rhs[: 2 * count])
            step = linear.pose_step + linear.M[:, : 2 * count] @ landmarks
            state.poses[k] = before.poses[k] + step
            state.landmarks[:count] = before.landmarks[:count] + landmarks.reshape(-1, 2)
        return step

    def converge(self) -> bool:
        """Whether chord steps come to rest, all linearised anew where they take too little away."""
        self._mixing, self._sizes = AndersonAcceleration() if len(self._mapped) >= LARGE else None, []
        before = smallest = np.inf
        for _ in range(MAX_STEPS):
            size = self._chord_step()
            if not size < GROWN * smallest:
                return False
            rate = max(size / before, RATE if self._mixing is None else SLOW)  # mixed steps have none of their own
            if (size * rate / (1.0 - rate) if before < np.inf and rate < 1.0 else size) < CONVERGED:
                return True
            self._sizes.append(size)
            back = 1 if self._mixing is None else 2
            if len(self._sizes) > back and size > SLOW * self._sizes[-1 - back]:
                self._mixing = AndersonAcceleration()
                if not self.relinearise():
                    return False
            before, smallest = size, min(size, smallest)
        return False

    def _chord_step(self) -> float:
        """Move by one, mixed with those before; how far it would move the newest pose and what was observed, in sigmas.

        That is nan if there is none.
        """
        measured, linear, state, step = self._measured, self._linear, self._state, self._step
        k, count = self.newest, len(self._mapped)
        change, self.chi_square = chord_kernels.compute_defects(measured, linear, state, k, step)
        if change * self._reach() > STALE and not self.relinearise():
            return np.nan
        chord_kernels.smooth(linear, k, step)
        chord_kernels.subtract_pose_step(measured, linear, k, step)
        step.landmark[:count] = self._solve(step.landmark[:count].ravel()).reshape(-1, 2)
        chord_kernels.subtract_landmark_step(measured, linear, k, step)
        chord_kernels.smooth(linear, k, step)
        chord_kernels.predict_changes(measured, linear, k, step)
        seen = step.seen[: measured.first[k + 1]].ravel()
        size = max(float(np.linalg.norm(seen)), float(np.max(np.abs(step.pose[k]) / self.sigma)))
        if not size < np.inf:
            return np.nan
        if self._mixing is not None:
            self._mix(self._mixing, seen)
        chord_kernels.move(measured, state, k, count, step)
        return size

    def _mix(self, mixing: AndersonAcceleration, seen: Float) -> None:
        """Mix the step, by which what is seen would change by `seen` (s,), with those before."""
        step, k, count = self._step, self.newest, len(self._mapped)
        parts = step.pose[: k + 1], step.landmark[:count]
        scaled = np.concatenate([seen, step.pose[k] / self.sigma])
        mixed = mixing.move(np.concatenate([each.ravel() for each in parts]), scaled)
        mixing.moved(mixed)
        for part, moved in zip(parts, np.split(mixed, [3 * k + 3]), strict=True):
            part[:] = moved.reshape(part.shape)

    def _reach(self) -> float:
        """How far a sigma of the newest pose would move what is seen from it, in sigmas; at least 1.

        So much better is what observations say of one another than of the world: matrices whose Jacobians are stale by
        one over this take the one for the other.
        """
        return max(1.0, float(np.sqrt(np.sum(self._linear.N[self.newest] * self.newest_cov()))))

    def relinearise(self) -> bool:
        """Take in all poses again, linearised where path and map stand; whether that determines all landmarks."""
        self._sizes, self._mixing = [], None if self._mixing is None else AndersonAcceleration()
        k, count, at = self.newest, len(self._mapped), self._linear.at
        at.poses[: k + 1] = self._state.poses[: k + 1]
        at.landmarks[:count] = self._state.landmarks[:count]
        self._linear.information[: 2 * count, : 2 * count] = 0.0
        return self._eliminate_poses(self._state, 0) and self._factorise()

    def add_newest_pose(self) -> bool:
        """Take in the newest pose and its scan where it stands; whether that is possible."""
        return self._eliminate_poses(self._state, self.newest)

    def _eliminate_poses(self, before: State, since: int) -> bool:
        """Take in the poses from number `since` on; the newest pose and the map are expected at `before`.

        Returns whether that is possible: a landmark on the pose that sees it has no Jacobians.
        """
        landmarks, until = len(self._mapped), self.newest + 1
        self._newest_cov = None
        try:
            pose_elimination.eliminate_poses(
                self._measured, self._linear, self._state, before, landmarks, (since, until)
            )
        except LinAlgError:
            return False
        return True

    def _factorise(self) -> bool:
        """Whether what the poses leave of the landmarks' information has a factor that rounding does not hide."""
        width = 2 * len(self._mapped)
        information = self._linear.information[:width, :width]
        upper, indefinite = factorise(information.T) if width else (information, 0)
        if indefinite or (np.square(upper.diagonal()) < EXHAUSTED * information.diagonal()).any():
            return False
        self._factor = upper.T
        sigma = np.sqrt(np.maximum(self.newest_cov().diagonal(), 0.0))
        self.sigma = np.where(sigma > EXACT, sigma, np.inf)
        return True

    def _solve(self, right: Float) -> Float:
        return solved(self._factor.T, right)[0] if len(right) else right
