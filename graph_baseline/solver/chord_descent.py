"""Path, map and linear system of an incremental optimum: new scans, chord steps to the minimum, relinearisation.

The linear system is linearised at one state, `at`: a pose joins it where it is when its scan is added, a landmark where
it is when it becomes active. Chord steps (`chord_kernels`) use its matrices with the gradient at the current state.
They converge to a point where the gradient of the exact cost is zero. If they converge too slowly, all poses are
eliminated again at the current state. Steps are accelerated (`anderson`) in large maps, where that costs as much as
many chord steps, and in any map after it was necessary.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import get_lapack_funcs, solve_triangular

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.linearisation import GraphArrays, Scans, empty_model, linearise
from slamgauge.graph_baseline.solver import chord_kernels
from slamgauge.graph_baseline.solver.active_landmarks import ActiveLandmarks, State
from slamgauge.graph_baseline.solver.anderson import AndersonAcceleration
from slamgauge.graph_baseline.solver.elimination import eliminate_poses, empty_chain, empty_frontier
from slamgauge.graph_baseline.solver.smoother import EXACT, LOST_PIVOT, NOT_DAMPED, POSES_TOGETHER, own_blocks
from slamgauge.jit import direct

factorise, solve_factored, solve_lower = get_lapack_funcs(("potrf", "potrs", "trtrs"), dtype=np.float64)

CONVERGED = 0.003  # largest remaining step, in sigmas of the newest pose and of the predicted observations
RATE = 0.2  # smallest assumed ratio of consecutive chord steps
FIRST = 10.0  # largest assumed size of the rest after the first step, relative to this step
UNEVEN = 4.0  # mean squared residual above which the ratio of consecutive chord steps varies
SLOW = 0.6  # relinearise if a step exceeds this share of the previous one (accelerated steps: the one before that)
STALE = 0.1  # relinearise if the relative change of Jacobians times `_reach` exceeds this
LARGE = 100  # landmarks; in larger maps a few accelerated steps cost less than a relinearisation
GROWN = 10.0  # chord steps diverge if a step exceeds the smallest one by this factor
MAX_CHORD_STEPS = 20
SCAN_PASSES = 2  # Gauss-Newton steps on the newest scan


class ChordDescent:
    """Current path and map, and the linear system of the poses added so far.

    Args:
        arrays: the problem; slots are those of the active landmarks.
        state: current poses and landmarks, which this class changes.
        mapped: the active landmarks.

    Attributes:
        newest: number of the newest pose; -1 before the first.
        chi_square: sum of squared residuals at the last chord step.
    """

    def __init__(self, arrays: GraphArrays, state: State, mapped: ActiveLandmarks) -> None:
        poses, landmarks, sizes = len(state.poses), len(state.landmarks), arrays.value.shape
        self._arrays, self._state, self._mapped = arrays, state, mapped
        self._scans = Scans(arrays.first, arrays.slot)
        self._at = State(np.zeros((poses, 3)), np.zeros((landmarks, 2)))
        self._model, self._now = empty_model(poses, *sizes), empty_model(poses, *sizes)  # at `at`; at the state
        self._chain, self._front = empty_chain(poses), empty_frontier(2 * landmarks)
        self._step = chord_kernels.empty_step(poses, landmarks, *sizes)
        self._acceleration: AndersonAcceleration | None = None  # None: steps are not accelerated
        self._sizes: list[float] = []  # sizes of the steps since the last relinearisation
        self._use_machine_code()
        self._factor: Float = np.zeros((0, 0))  # (2L, 2L) lower triangular factor of the landmarks' information
        self._newest_cov: Float | None = None  # computed on request
        self.newest = -1
        self._sigma: Float | None = None  # computed on request
        self.chi_square = 0.0

    def _use_machine_code(self) -> None:
        """Store the machine code of the kernels, which are called several times for each scan."""
        scans, model, step, pose = self._scans, self._model, self._step, (0, 1)
        self._linearise = direct(linearise, self._arrays, *self._at, pose, model)
        self._eliminate_poses = direct(
            eliminate_poses, scans, model, NOT_DAMPED.pose, self._chain, self._front, pose, *np.empty((2, 1, 3, 1))
        )
        self._compute_gradient = direct(chord_kernels.compute_gradient, scans, 0, model, model, step)
        self._solve_step = direct(chord_kernels.solve_step, scans, model, self._chain, np.zeros((1, 1)).T, 0, step)

    def newest_cov(self) -> Float:
        """Return the covariance (3, 3) of the newest pose, world frame, from the current matrices."""
        if self._newest_cov is None:
            width = len(self._factor)
            cov = self._front.P
            if width:
                spread = solve_lower(self._factor.T, self._front.M[:, 1 : 1 + width].T, trans=1)[0]
                cov = cov + spread.T @ spread
            self._newest_cov = 0.5 * (cov + cov.T)
        return self._newest_cov

    @property
    def sigma(self) -> Float:
        """(3,) standard deviations of the newest pose at the last factorisation; infinite for exact ones."""
        if self._sigma is None:
            sigmas = [math.sqrt(max(variance, 0.0)) for variance in self.newest_cov().diagonal().tolist()]
            self._sigma = np.array([sigma if sigma > EXACT else math.inf for sigma in sigmas])
        return self._sigma

    def landmark_covs(self) -> Float:
        """Return the covariances (L, 2, 2) [m^2] of the landmarks."""
        identity = np.eye(len(self._factor))
        return own_blocks(solve_triangular(self._factor, identity, trans=1, lower=True, check_finite=False))

    # --- new poses and scans ---------------------------------------------------------------------

    def add_pose(self, pose: Float) -> None:
        """Append the predicted newest pose (3,)."""
        self.newest += 1
        self._state.poses[self.newest] = self._at.poses[self.newest] = pose

    def add_newest_pose(self) -> bool:
        """Add the newest pose and its scan at the current state; return False if that is impossible."""
        self._linearise(self._arrays, *self._at, (self.newest, self.newest + 1), self._model)
        return self._eliminate(self.newest)

    def add_newest_scan(self, new: int) -> Float | None:
        """Add the newest scan with SCAN_PASSES Gauss-Newton steps on it; the last `new` active landmarks are new.

        Returns:
            The change (3,) of the newest pose; None if the matrices do not determine all landmarks.
        """
        k, count, state, at, front = self.newest, len(self._mapped), self._state, self._at, self._front
        added, width, step = slice(count - new, count), 1 + 2 * count, np.zeros(3)
        rows = slice(*self._arrays.first[k : k + 2])
        slot, model, now = self._arrays.slot[rows], self._model, self._now
        predicted, mapped = state.poses[k].copy(), state.landmarks.copy()
        saved = front.M[:, :width].copy(), front.P.copy(), front.information[:width, :width].copy()
        for again in range(SCAN_PASSES):
            if again:
                front.M[:, :width], front.P[:], front.information[:width, :width] = saved
            at.poses[k], at.landmarks[added] = state.poses[k], state.landmarks[added]
            self._linearise(self._arrays, *at, (k, k + 1), model)
            self._linearise(self._arrays, *state, (k, k + 1), now)
            # Residuals are extrapolated to the predicted pose and map, where the motion has no residual.
            back = (mapped[slot] - state.landmarks[slot])[:, :, None]
            model.c[k] = 0.0
            model.r[rows] = (
                now.r[rows] + model.Hx[rows] @ (predicted - state.poses[k]) + (model.Hm[rows] @ back)[..., 0]
            )
            front.M[:, 0], front.information[:width, 0] = 0.0, 0.0  # earlier steps are at their minimum
            if not (self._eliminate(k) and self._factorise()):
                return None
            right = -front.information[1:width, 0]
            moved = solve_factored(self._factor.T, right)[0] if count else right
            step = front.M[:, 0] + front.M[:, 1:width] @ moved
            state.poses[k], state.landmarks[:count] = predicted + step, mapped[:count] + moved.reshape(-1, 2)
        return step

    # --- chord steps -----------------------------------------------------------------------------

    def converge(self) -> bool:
        """Take chord steps, with relinearisations where they shrink too slowly; return whether they converged."""
        self._acceleration, self._sizes = AndersonAcceleration() if len(self._mapped) >= LARGE else None, []
        before = smallest = np.inf
        for _ in range(MAX_CHORD_STEPS):
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
        measured = self._scans.first[self.newest + 1] * self._model.r.shape[1]
        return self._acceleration is not None or self.chi_square > UNEVEN * measured

    def _chord_step(self) -> float:
        """Take one chord step, accelerated if acceleration is in use.

        Returns:
            Size of the step before acceleration in standard deviations: the larger change of the newest pose and of the
            predicted observations; NaN if the step is not finite.
        """
        k, state, step = self.newest, self._state, self._step
        self._linearise(self._arrays, *state, (0, k + 1), self._now)
        self.chi_square, change = self._compute_gradient(self._scans, k, self._model, self._now, step)
        if change * self._reach() > STALE and not self.relinearise():
            return np.nan
        seen = self._solve_step(self._scans, self._model, self._chain, self._factor, k, step)
        size = max(seen, float(np.max(np.abs(step.pose[k]) / self.sigma)))
        if not size < np.inf:
            return np.nan
        if self._acceleration is not None:
            self._accelerate(self._acceleration)
        chord_kernels.move(self._scans, state.poses[: k + 1], state.landmarks[: len(self._mapped)], step)
        return size

    def _accelerate(self, acceleration: AndersonAcceleration) -> None:
        """Accelerate the step so that predicted observations and the newest pose change least, in sigmas."""
        step, k = self._step, self.newest
        parts = step.pose[: k + 1], step.landmark[: len(self._mapped)]
        scaled = np.concatenate([step.seen[: self._scans.first[k + 1]].ravel(), step.pose[k] / self.sigma])
        mixed = acceleration.accelerate(np.concatenate([each.ravel() for each in parts]), scaled)
        acceleration.record(mixed)
        for part, moved in zip(parts, np.split(mixed, [3 * k + 3]), strict=True):
            part[:] = moved.reshape(part.shape)

    def _reach(self) -> float:
        """Return the standard deviation of predicted observations due to the newest pose, in sigmas of R, at least 1.

        A relative error of a Jacobian times this factor is an error of the observation in sigmas.
        """
        H = self._model.Hx[slice(*self._scans.first[self.newest : self.newest + 2])].reshape(-1, 3)
        return max(1.0, math.sqrt(float(np.sum(H @ self.newest_cov() * H))))

    def relinearise(self) -> bool:
        """Eliminate all poses again at the current state; return whether the result determines all landmarks."""
        self._sizes, self._acceleration = [], None if self._acceleration is None else AndersonAcceleration()
        end, at, front = self.newest + 1, self._at, self._front
        at.poses[:end], at.landmarks[:] = self._state.poses[:end], self._state.landmarks
        self._linearise(self._arrays, *at, (0, end), self._model)
        front.M[:], front.P[:], front.information[:] = 0.0, 0.0, 0.0
        return self._eliminate(0) and self._factorise()

    # --- linear system ---------------------------------------------------------------------------

    def _eliminate(self, since: int) -> bool:
        """Eliminate the poses from number `since` on; return False if their matrices are not finite."""
        width, end, self._newest_cov = 1 + 2 * len(self._mapped), self.newest + 1, None
        information = self._front.information[:width, :width]
        try:
            for first in range(since, end, POSES_TOGETHER):
                last = min(first + POSES_TOGETHER, end)
                maps, rows = np.empty((2, last - first, 3, width))
                self._eliminate_poses(
                    self._scans, self._model, NOT_DAMPED.pose, self._chain, self._front, (first, last), maps, rows
                )
                stacked = rows.reshape(-1, width)
                information += stacked.T @ stacked
        except LinAlgError:
            return False
        return True

    def _factorise(self) -> bool:
        """Factorise the landmarks' information; return False if it is indefinite or only rounding."""
        width = 1 + 2 * len(self._mapped)
        information = self._front.information[1:width, 1:width]
        upper, indefinite = factorise(information.T) if width > 1 else (information, 0)
        if indefinite or (np.square(upper.diagonal()) < LOST_PIVOT * information.diagonal()).any():
            return False
        self._factor = upper.T
        self._sigma = None
        return True
