"""Chord steps to the minimum of an incremental optimum.

Chord (simplified Newton) steps use each pose's matrices from the time when it was added (`pose_elimination`) and the
gradient at the current state (`chord_kernels`). They converge to a point where the gradient of the exact cost is zero.
If they converge too slowly, all matrices are relinearised. Steps are accelerated (`anderson`) in large maps, where a
relinearisation costs as much as many chord steps, and in any map after a relinearisation was necessary.
"""

from __future__ import annotations

import math

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

CONVERGED = 0.003  # largest remaining step, in sigmas of the newest pose and of the predicted observations
RATE = 0.2  # smallest assumed ratio of consecutive chord steps
FIRST = 10.0  # largest assumed size of the rest after the first step, relative to this step
MISFIT = 4.0  # mean squared residual above which the ratio of consecutive chord steps varies
SLOW = 0.6  # relinearise if a step exceeds this share of the previous one (accelerated steps: the one before that)
STALE = 0.1  # relinearise if the relative change of Jacobians times `_reach` exceeds this
LARGE = 100  # landmarks; in larger maps a few accelerated steps cost less than a relinearisation
GROWN = 10.0  # chord steps diverge if a step exceeds the smallest one by this factor
MAX_STEPS = 20
PASSES = 2  # Gauss-Newton steps on the newest scan
EXACT = 1e-9  # a smaller standard deviation is treated as zero [m or rad]


class ChordDescent:
    """Current path and map, and the linear system of the poses added so far.

    Args:
        measured: known association.
        state: current poses and landmarks, which this class changes.
        mapped: the active landmarks.

    Attributes:
        newest: number of the newest pose; -1 before the first.
        sigma: (3,) standard deviations of the newest pose at the last factorisation; infinite for exact ones.
        chi_square: sum of squared residuals at the last chord step.
    """

    def __init__(self, measured: Measured, state: State, mapped: ActiveLandmarks) -> None:
        self._measured, self._state, self._mapped = measured, state, mapped
        sizes = len(state.poses), len(state.landmarks), *measured.value.shape
        self._linear = linear_problem.allocate_linear(*sizes)
        self._before = linear_problem.allocate_state(*sizes[:2])  # prediction of the newest pose and the map
        self._step = chord_kernels.allocate_chord(*sizes)
        self._acceleration: AndersonAcceleration | None = None  # None: steps are not accelerated
        self._sizes: list[float] = []  # sizes of the steps since the last relinearisation
        self._factor: Float = np.zeros((0, 0))  # (2L, 2L) lower triangular factor of the landmarks' information
        self._newest_cov: Float | None = None  # computed on request
        self.newest = -1
        self.sigma = np.full(3, np.inf)
        self.chi_square = 0.0

    def add_pose(self, pose: Float) -> None:
        """Append the predicted newest pose (3,)."""
        self.newest += 1
        self._state.poses[self.newest] = self._linear.at.poses[self.newest] = pose

    def newest_cov(self) -> Float:
        """Return the covariance (3, 3) of the newest pose, world frame, from the current matrices."""
        if self._newest_cov is None:
            self._newest_cov = np.empty((3, 3))
            pose_elimination.newest_covariance(self._linear, self._factor, self._newest_cov)
        return self._newest_cov

    def landmark_covs(self) -> Float:
        """Return the covariances (L, 2, 2) [m^2] of the landmarks."""
        return own_blocks_of_inverse(self._factor)

    def add_newest_scan(self, mapped: int) -> Float | None:
        """Add the newest scan with PASSES Gauss-Newton steps on it; landmarks from number `mapped` on are new.

        Returns:
            The change (3,) of the newest pose; None if the matrices do not determine all landmarks.
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
        """Take chord steps, with relinearisations where they shrink too slowly; return whether they converged."""
        self._acceleration, self._sizes = AndersonAcceleration() if len(self._mapped) >= LARGE else None, []
        before = smallest = np.inf
        for _ in range(MAX_STEPS):
            size = self._chord_step()
            if not size < GROWN * smallest:
                return False
            rate = max(size / before, SLOW if self._is_ratio_uncertain() else RATE)
            rest = rate / (1.0 - rate) if rate < 1.0 else 1.0
            if size * (rest if before < np.inf else FIRST) < CONVERGED:
                return True
            self._sizes.append(size)
            back = 1 if self._acceleration is None else 2
            if len(self._sizes) > back and size > SLOW * self._sizes[-1 - back]:
                self._acceleration = AndersonAcceleration()
                if not self.relinearise():
                    return False
            before, smallest = size, min(size, smallest)
        return False

    def _is_ratio_uncertain(self) -> bool:
        """Return whether the ratio of consecutive steps varies: steps are accelerated, or residuals above the noise."""
        measured = self._measured.first[self.newest + 1] * self._measured.value.shape[1]
        return self._acceleration is not None or self.chi_square > MISFIT * measured

    def _chord_step(self) -> float:
        """Take one chord step, accelerated if acceleration is in use.

        Returns:
            Size of the step before acceleration in standard deviations: the larger change of the newest pose and of the
            predicted observations; NaN if the step is not finite.
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
        if self._acceleration is not None:
            self._accelerate(self._acceleration, seen)
        chord_kernels.move(measured, state, k, count, step)
        return size

    def _accelerate(self, acceleration: AndersonAcceleration, seen: Float) -> None:
        """Accelerate the step, which changes the predicted observations by `seen` (s,) standard deviations."""
        step, k, count = self._step, self.newest, len(self._mapped)
        parts = step.pose[: k + 1], step.landmark[:count]
        scaled = np.concatenate([seen, step.pose[k] / self.sigma])
        mixed = acceleration.accelerate(np.concatenate([each.ravel() for each in parts]), scaled)
        acceleration.record(mixed)
        for part, moved in zip(parts, np.split(mixed, [3 * k + 3]), strict=True):
            part[:] = moved.reshape(part.shape)

    def _reach(self) -> float:
        """Return the standard deviation of predicted observations due to the newest pose, in sigmas of R, at least 1.

        A relative error of a Jacobian times this factor is an error of the observation in sigmas.
        """
        return max(1.0, float(np.sqrt(np.sum(self._linear.N[self.newest] * self.newest_cov()))))

    def relinearise(self) -> bool:
        """Eliminate all poses again at the current state; return whether the result determines all landmarks."""
        self._sizes, self._acceleration = [], None if self._acceleration is None else AndersonAcceleration()
        k, count, at = self.newest, len(self._mapped), self._linear.at
        at.poses[: k + 1] = self._state.poses[: k + 1]
        at.landmarks[:count] = self._state.landmarks[:count]
        self._linear.information[: 2 * count, : 2 * count] = 0.0
        return self._eliminate_poses(self._state, 0) and self._factorise()

    def add_newest_pose(self) -> bool:
        """Add the newest pose and its scan at the current state; return False if that is impossible."""
        return self._eliminate_poses(self._state, self.newest)

    def _eliminate_poses(self, before: State, since: int) -> bool:
        """Eliminate the poses from number `since` on; `before` contains the predicted newest pose and map.

        Returns False if it is impossible, because a landmark at the pose that observes it has no Jacobian.
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
        """Factorise the landmarks' information; return False if it is indefinite or only rounding."""
        width = 2 * len(self._mapped)
        information = self._linear.information[:width, :width]
        upper, indefinite = factorise(information.T) if width else (information, 0)
        if indefinite or (np.square(upper.diagonal()) < EXHAUSTED * information.diagonal()).any():
            return False
        self._factor = upper.T
        sigmas = [math.sqrt(max(variance, 0.0)) for variance in self.newest_cov().diagonal().tolist()]
        self.sigma = np.array([sigma if sigma > EXACT else math.inf for sigma in sigmas])
        return True

    def _solve(self, right: Float) -> Float:
        return solved(self._factor.T, right)[0] if len(right) else right
