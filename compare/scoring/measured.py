"""Metrics of an estimate: the name of a method is the key, its docstring the meaning in the manual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamgauge.compare.scoring.consistency import distances, is_inside, pose_errors, squared_mahalanobis, step_errors
from slamgauge.compare.scoring.intervals import ROUNDING, mean, number, rms
from slamgauge.compare.scoring.metric import Column, of_run
from slamgauge.compare.scoring.run_arrays import RunArrays, closure_steps, pose_covs_of
from slamgauge.compare.scoring.runs import Runs


@dataclass(frozen=True)
class LoopClosure:
    """Position error, and root of the trace of its covariance, before and at a loop closure; None if unknown."""

    step: int
    error_before_m: float | None
    error_after_m: float | None
    sigma_before_m: float | None
    sigma_after_m: float | None


class Measured(RunArrays):
    """An estimate, the known part of the truth, and the optima; metrics are None if they need an unknown part."""

    @of_run(Column("ATE [m]", run=1, study=1, sweep=1), averaged=True)
    def ate_m(self) -> float | None:
        """RMS position error over the poses with truth, without alignment."""
        return rms(self.off)

    @of_run(Column("heading [rad]", "heading error [rad]", form="{:.4f}", run=6, study=8), Runs.heading_rmse)
    def heading_rmse_rad(self) -> float | None:
        """RMS heading error; in studies, mean over steps of the RMS over runs."""
        return rms(self.errors[:, 2])

    @of_run(Column("end [m]", "final position error [m]", run=7, study=9), averaged=True)
    def final_position_error_m(self) -> float | None:
        """Position error of the last pose."""
        return number(self.off[-1] if self.compared is None else self.off[self.compared][-1])

    @of_run()
    def rpe_m(self) -> float | None:
        """RMS translation error of single steps, in the body frame."""
        return rms(step_errors(self.reference, self.estimate.poses))

    @of_run(Column("NEES", form="{:.2f}", run=3))
    def nees_pose(self) -> float | None:
        """Mean over time of the pose NEES: about 3 if the estimate is consistent."""
        return mean(self.nees)

    @of_run(Column("NEES xy", form="{:.2f}", run=3))
    def nees_position(self) -> float | None:
        """Mean over time of the position NEES: about 2 if consistent (a column if headings are unknown)."""
        return mean(self.nees_xy)

    @of_run(Column("in 95% ellipse", form="{:.1%}", run=4, study=6), Runs.late_coverage)
    def coverage_95(self) -> float | None:
        """Share of the positions inside their 95 % ellipses; in studies from the 11th step on."""
        return mean(is_inside(self.nees_xy, 0.95))

    @of_run(stored=True)
    def nis_total(self) -> float:
        """Sum of the NIS of all steps."""
        return 0.0 if self.estimate.nis is None else float(self.estimate.nis.sum())

    @of_run(stored=True)
    def nis_dof_total(self) -> int:
        """Degrees of freedom of the NIS of all steps."""
        return 0 if self.estimate.nis_dof is None else int(self.estimate.nis_dof.sum())

    @of_run(Column("NIS/dof", run=5, study=7), Runs.total_nis)
    def nis_per_dof(self) -> float | None:
        """NIS over its degrees of freedom: about 1 if the assumed noise is right."""
        return self.nis_total() / self.nis_dof_total() if self.nis_dof_total() else None

    @of_run(Column("map [m]", "map error [m]", run=9), averaged=True)
    def landmark_rmse_m(self) -> float | None:
        """RMS distance of the mapped landmarks from the true ones, at the end."""
        return rms(self.map_off)

    @of_run(Column("map NEES/2", "landmark NEES/2", form="{:.2f}", study=10), averaged=True)
    def landmark_nees_per_dof(self) -> float | None:
        """Mean NEES of the mapped landmarks over its 2 degrees of freedom."""
        return mean(self.map_nees / 2)

    @of_run(stored=True)
    def landmark_sigma_near_m(self) -> float | None:
        """RMS sigma of the half of the map that is nearer to the start."""
        return rms(self.map_sigmas[self.halves[0]])

    @of_run(stored=True)
    def landmark_sigma_far_m(self) -> float | None:
        """RMS sigma of the farther half of the map."""
        return rms(self.map_sigmas[self.halves[1]])

    @of_run(stored=True)
    def landmark_error_near_m(self) -> float | None:
        """RMS error of the nearer half of the map."""
        return rms(self.map_off[self.halves[0]])

    @of_run(stored=True)
    def landmark_error_far_m(self) -> float | None:
        """RMS error of the farther half of the map."""
        return rms(self.map_off[self.halves[1]])

    @of_run(Column("mapped", "mapped landmarks", form="{:.1f}", run=10, study=12, sweep=7), averaged=True)
    def landmarks_mapped(self) -> int:
        """Number of landmarks in the map."""
        return len(self.estimate.landmark_ids)

    @of_run(Column("of", "true landmarks", run=11), stored=True)
    def landmarks_true(self) -> int | None:
        """Number of distinct landmarks that were observed."""
        return None if self.observed is None else len(self.observed)

    @of_run(averaged=True)
    def landmarks_missed(self) -> int | None:
        """Number of observed landmarks without a counterpart in the map."""
        is_known = self.estimate.association is not None or self.recording.landmark is not None
        return len(np.setdiff1d(self.observed, self.true_ids)) if self.observed is not None and is_known else None

    @of_run(Column("wrong", "wrong associations", form="{:.1f}", run=8, study=11, sweep=8), averaged=True)
    def wrong_associations(self) -> int | None:
        """Number of observations that are assigned to another landmark than their own."""
        return None if self.wrong is None else int(self.wrong.sum())

    @of_run(Column("x optimum", form="{:.2f}", run=2, relative=True), Runs.over_optimum)
    def ratio_to_optimum(self) -> float | None:
        """ATE over that of the optimum of the same kind, paired run by run."""
        if self.optimum is None:
            return None
        ate, best = self.ate_m(), rms(distances(pose_errors(self.reference, self.optimum.poses)))
        return ate / best if ate is not None and best is not None and best > ROUNDING else None

    @of_run(Column("d to optimum", "Mahalanobis distance² to the optimum", form="{:.3g}", run=12, relative=True))
    def mahalanobis_to_optimum(self) -> float | None:
        """Mean over time of the squared Mahalanobis distance to the optimum, under its covariance."""
        if self.optimum is None:
            return None
        differences = pose_errors(self.optimum.poses, self.estimate.poses)
        squares = squared_mahalanobis(differences, pose_covs_of(self.optimum))
        return mean(squares if self.compared is None else squares[self.compared])

    @of_run(stored=True)
    def optimum_check_sigma(self) -> float | None:
        """Distance of a causal optimum's last pose and sigmas from the hindsight optimum's, in sigmas of the latter."""
        return self.estimate.optimum_check

    @of_run()
    def yardstick_check_sigma(self) -> float | None:
        """`optimum_check_sigma` of the optimum with which the estimate is compared."""
        return None if self.optimum is None else self.optimum.optimum_check

    @of_run(averaged=True)
    def chi_square_per_dof(self) -> float | None:
        """Squared residuals of an optimum over their degrees of freedom: about 1 if the stated noise is right."""
        chi_square, dof = self.estimate.chi_square, self.estimate.chi_square_dof
        return chi_square / dof if chi_square is not None and dof else None

    @of_run()
    def loop_closure(self) -> tuple[LoopClosure, ...] | None:
        """One entry per loop closure (`measured.LoopClosure`)."""
        steps = closure_steps(self.truth, self.recording)
        if steps is None:
            return None
        sigmas = np.sqrt((self.covs[:, 0, 0] + self.covs[:, 1, 1]).clip(min=0))
        rows = np.column_stack([self.off[steps - 1], self.off[steps], sigmas[steps - 1], sigmas[steps]])
        return tuple(LoopClosure(step, *map(number, row)) for step, row in zip(steps.tolist(), rows, strict=True))

    @of_run(Column("time [s]", "computing time [s]", form="{:.2f}", run=14), Runs.mean_seconds, stored=True)
    def seconds_total(self) -> float | None:
        """Computing time."""
        return None if self.estimate.seconds is None else float(self.estimate.seconds.sum())
