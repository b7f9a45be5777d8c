"""Catalogue of metrics, and their columns in tables; here those of an estimate, in `runs` those of a study.

The name of a decorated method is the key of a metric, its docstring the meaning in the manual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.scoring.consistency import distances, is_inside, pose_errors, squared_mahalanobis, step_errors
from slamgauge.compare.scoring.intervals import ROUNDING, mean, number, rms
from slamgauge.compare.scoring.run_arrays import RunArrays, closure_steps, pose_covs_of
from slamgauge.compare.scoring.runs import BY_KEY, RAYS, Column, Runs, of_run
from slamgauge.compare.scoring.table import Cell, Head, figure, marked
from slamgauge.compare.scoring.verdicts import Evidence
from slamgauge.estimate import RayLog
from slamgauge.truth import NOBODY

FAR_OFF = 9.0  # squared Mahalanobis distance of three sigma
HALVES = ("error_near_m", "error_far_m", "sigma_near_m", "sigma_far_m")  # figures of `Measured.map_halves`


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

    @of_run(stored=HALVES)
    def map_halves(self) -> dict[str, float | None] | None:
        """RMS error and sigma of the half of the map that is nearer to the start, and of the farther half."""
        way = distances(self.from_truth(self.true_ids, np.tile(self.reference[0, :2], (len(self.true_ids), 1))))
        if np.isnan(way).all():
            return None
        near, far = way <= np.nanmedian(way), way > np.nanmedian(way)
        sigmas = np.sqrt(np.trace(self.map_covs, axis1=1, axis2=2).clip(min=0))
        figures = (self.map_off[near], self.map_off[far], sigmas[near], sigmas[far])
        return dict(zip(HALVES, map(rms, figures), strict=True))

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
        """At each loop closure its `step`, and the errors and sigmas of the position before and after it."""
        steps = closure_steps(self.truth, self.recording)
        if steps is None:
            return None
        sigmas = np.sqrt((self.covs[:, 0, 0] + self.covs[:, 1, 1]).clip(min=0))
        rows = np.column_stack([self.off[steps - 1], self.off[steps], sigmas[steps - 1], sigmas[steps]])
        return tuple(LoopClosure(step, *map(number, row)) for step, row in zip(steps.tolist(), rows, strict=True))

    @of_run(Column("time [s]", "computing time [s]", form="{:.2f}", run=14), averaged=True)
    def seconds_total(self) -> float | None:
        """Computing time."""
        return None if self.estimate.seconds is None else float(self.estimate.seconds.sum())

    @of_run(over_runs=Runs.mean_rays, stored=RAYS)
    def rays(self) -> dict[str, float | None] | None:
        """Rays of a bearing-only estimate: mean number of `members` in the state, and rays by their result.

        `collapsed` rays became points, `lost` ones were deleted, `left` ones are rays at the end. A collapsed ray is
        `off` if its landmark is more than three sigma off at the end, and `wrong` if it is off, or if its survivor was
        not the member nearest to the truth at the ray's birth.
        """
        log = self.estimate.rays
        if log is None:
            return None
        collapsed, ended = log.survivor >= 0, log.end >= 0
        wrong, off = None, None
        if self.truth.poses is not None and self.truth.landmark_ids is not None:
            off = collapsed & np.isin(log.landmark, self.estimate.landmark_ids[self.map_nees > FAR_OFF])
            wrong = off | (collapsed & ~self._nearest_survived(log))
        marks = {"collapsed": collapsed, "wrong": wrong, "off": off, "lost": ended & ~collapsed, "left": ~ended}
        counts = {name: None if each is None else float(each.sum()) for name, each in marks.items()}
        return {"members": float(log.members.mean()), **counts}

    def _nearest_survived(self, log: RayLog) -> Marks:
        """Return whether each ray's survivor was at birth the member nearest to the true distance; True if unknown."""
        if not len(log.birth):  # without observations, rays have no members
            return np.zeros(0, dtype=np.bool_)
        owners = dict(zip(self.estimate.landmark_ids.tolist(), self.true_ids.tolist(), strict=True))
        owner = np.array([owners.get(name, NOBODY) for name in log.landmark.tolist()])
        true = distances(self.from_truth(owner, self.reference[log.birth, :2]))
        gaps = np.abs(log.distances - true[:, None])
        return np.isnan(gaps).all(axis=1) | (np.nan_to_num(gaps, nan=np.inf).argmin(axis=1) == log.survivor)

    @of_run(over_runs=Runs.verdict)
    def verdict(self) -> str | None:
        """Conclusions from the figures, in words (`verdicts`)."""
        nees = mean(self.nees / 3)
        evidence = Evidence(
            runs=1,
            nees_per_dof=mean(self.nees_xy / 2) if nees is None else nees,  # positions, without true headings
            coverage_95=self.coverage_95(),
            nis_per_dof=self.nis_per_dof(),
            nis_dof=self.nis_dof_total(),
            wrong_associations=self.wrong_associations(),
        )
        return evidence.verdict()


STORED = tuple(name for each in BY_KEY.values() for name in each.stored)


def measured(found: Measured, *, in_study: bool = False) -> dict[str, Any]:
    """Return the metrics of an estimate: by key those of a score, or by their names in `STORED` those of a study."""
    figures: dict[str, Any] = {}
    for key, each in BY_KEY.items():
        if each.measure is not None and (each.stored or not in_study):
            figure = each.measure(found)
            parts = figure.values() if isinstance(figure, dict) else [figure] * len(each.stored)
            figures |= dict(zip(each.stored, parts, strict=True)) if in_study else {key: figure}
    return figures


def heads(table: Literal["run", "study", "sweep"], *, bounded: bool = False) -> list[Column]:
    """Return the columns of metrics in a table, from the left; with those of bounds if `bounded`."""
    columns = [each.column for each in BY_KEY.values() if each.column is not None]
    shown = [each for each in columns if getattr(each, table) is not None and (bounded or not each.of_bounds)]
    return sorted(shown, key=attrgetter(table))


def figure_cells(entry: Mapping[str, Any], columns: Sequence[Head], is_marked: bool | None) -> list[Cell]:
    """Return the cells of an estimator in columns of metrics; None leaves no room for marks.

    Figures relative to an optimum are marked if it is in doubt. Counts of a run are whole numbers.
    """
    cells: list[Cell] = []
    for head in columns:
        value = entry[head.key]
        found = figure(value, "{:d}" if isinstance(value, int) else head.form)
        cells.append(marked(found, is_marked) if head.relative else found)
    return cells
