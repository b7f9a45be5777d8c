"""An estimate with what it is compared with. Arrays that several metrics need are computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.scoring.consistency import distances, pose_errors, squared_mahalanobis
from slamgauge.compare.scoring.intervals import number
from slamgauge.compare.scoring.landmark_identity import (
    AssociationFigures,
    association_figures,
    closure_steps,
    landmark_errors,
    true_landmarks,
)
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


@dataclass(frozen=True)
class LoopClosure:
    """Position error and uncertainty at a loop closure; None if unknown.

    `error_before_m` and `sigma_before_m` are those of the pose before `step`, the others those of the pose at `step`.
    A sigma is the root of the trace of the position covariance.
    """

    step: int
    error_before_m: float | None
    error_after_m: float | None
    sigma_before_m: float | None
    sigma_after_m: float | None


@dataclass(frozen=True)
class Measured:
    """An estimate, the known part of the truth, and the optima.

    Attributes:
        truth: known part of the truth; figures that need another part are undefined.
        recording: input of the estimator.
        estimate: output of the estimator.
        optimum: estimate of `causal` if `estimate` is filtered, of `batch` if it is smoothed; None: not compared.
        batch: the hindsight optimum, for the distance of the last pose.
        compared: (N+1,) the steps of which a stored trajectory has a pose; None: all.
    """

    truth: Truth
    recording: Recording
    estimate: Estimate
    optimum: Estimate | None = None
    batch: Estimate | None = None
    compared: Marks | None = None

    @cached_property
    def reference(self) -> Float:
        """True poses (N+1, 3); NaN where they are not known or not compared."""
        poses = self.truth.poses
        if poses is None:
            return np.full(self.estimate.poses.shape, np.nan)
        return poses if self.compared is None else np.where(self.compared[:, None], poses, np.nan)

    @property
    def last(self) -> int:
        """Last step that is compared."""
        return len(self.estimate.poses) - 1 if self.compared is None else int(np.flatnonzero(self.compared)[-1])

    @cached_property
    def errors(self) -> Float:
        """Additive errors (N+1, 3) of the poses [m, m, rad]."""
        return pose_errors(self.reference, self.estimate.poses)

    @cached_property
    def off(self) -> Float:
        """Position errors (N+1,) [m]."""
        return distances(self.errors)

    @cached_property
    def covs(self) -> Float:
        """Covariances (N+1, 3, 3) of the poses, all NaN if the estimator returns none."""
        return pose_covs_of(self.estimate)

    @cached_property
    def sigmas(self) -> Float:
        """Standard deviations (N+1, 3) of x, y [m] and heading [rad]."""
        return np.sqrt(np.diagonal(self.covs, axis1=1, axis2=2).clip(min=0))

    @cached_property
    def nees(self) -> Float:
        """NEES (N+1,) of the poses."""
        return squared_mahalanobis(self.errors, self.covs)

    @cached_property
    def nees_position(self) -> Float:
        """NEES (N+1,) of the positions."""
        return squared_mahalanobis(self.errors[:, :2], self.covs[:, :2, :2])

    @property
    def nis_total(self) -> float:
        """Sum of the NIS of all steps."""
        return 0.0 if self.estimate.nis is None else float(self.estimate.nis.sum())

    @property
    def nis_dof_total(self) -> int:
        """Degrees of freedom of the NIS of all steps."""
        return 0 if self.estimate.nis_dof is None else int(self.estimate.nis_dof.sum())

    @property
    def nis_per_dof(self) -> float | None:
        """NIS over its degrees of freedom; None without any."""
        return self.nis_total / self.nis_dof_total if self.nis_dof_total > 0 else None

    @cached_property
    def landmarks(self) -> tuple[Int, Float]:
        """True ids (L,), -1 if unknown, and positions (L, 2) [m] of the mapped landmarks."""
        return true_landmarks(self.truth, self.recording, self.estimate)

    @cached_property
    def map_errors(self) -> Float:
        """Errors (L, 2) of the mapped landmarks [m]; NaN for those of unknown truth."""
        return landmark_errors(*self.landmarks, self.truth.landmark_ids, self.truth.landmarks)

    @cached_property
    def map_covs(self) -> Float:
        """Covariances (L, 2, 2) of the mapped landmarks, all NaN if the estimator returns none."""
        covs = self.estimate.landmark_covs
        return np.full((len(self.map_errors), 2, 2), np.nan) if covs is None else covs

    @property
    def map_sigmas(self) -> Float:
        """Position sigmas (L,) of the mapped landmarks [m]."""
        return np.sqrt(np.trace(self.map_covs, axis1=1, axis2=2).clip(min=0))

    @cached_property
    def halves(self) -> tuple[Marks, Marks]:
        """Which mapped landmarks (L,) are in the half nearer to the true start, and which in the farther half."""
        ids, known = self.landmarks[0], self.truth.landmark_ids
        start = np.tile(self.reference[0, :2], (len(ids), 1))
        far = distances(landmark_errors(ids, start, known, self.truth.landmarks))
        middle = np.median(far[~np.isnan(far)]) if not np.isnan(far).all() else np.nan
        return far <= middle, far > middle

    @cached_property
    def associations(self) -> AssociationFigures:
        """Figures of the data association."""
        return association_figures(self.truth, self.recording, self.estimate)

    @property
    def loop_closures(self) -> tuple[LoopClosure, ...] | None:
        """Errors and sigmas at the loop closures; None without ids."""
        steps = closure_steps(self.truth, self.recording)
        if steps is None:
            return None
        sigmas = np.sqrt((self.covs[:, 0, 0] + self.covs[:, 1, 1]).clip(min=0))
        rows = np.column_stack([self.off[steps - 1], self.off[steps], sigmas[steps - 1], sigmas[steps]])
        return tuple(LoopClosure(step, *map(number, row)) for step, row in zip(steps.tolist(), rows, strict=True))


def pose_covs_of(estimate: Estimate) -> Float:
    """Return the pose covariances (N+1, 3, 3), all NaN if the estimator returns none."""
    return np.full((len(estimate.poses), 3, 3), np.nan) if estimate.pose_covs is None else estimate.pose_covs
