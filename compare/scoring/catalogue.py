"""List of all metrics. A new metric needs an entry here and the functions that compute it; all else follows from it.

`Score` (a run), `EstimatorSummary` (a study), their files, stores, tables and pages, and the manual
(`docs/make_tables.py`) have a metric by its key.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any, Literal

from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.scoring import optimum_notes, verdicts
from slamgauge.compare.scoring.consistency import distances, is_inside, step_errors
from slamgauge.compare.scoring.intervals import mean, mean_interval, number, rms
from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.ray_figures import RAY_FIGURES, mean_rays, ray_figures
from slamgauge.compare.scoring.runs import (
    BAND_LEVEL,
    OverRuns,
    late_coverage,
    late_mean_of,
    mean_of,
    mean_root_of,
    over_bound,
    over_optimum,
    reported_sigma,
    share_inside_band,
    total_nis,
)
from slamgauge.compare.scoring.table import MARK, Cell, Head, figure, marked

TableName = Literal["run", "study", "sweep"]
Measure = Callable[[Measured], Any]  # returns a figure, or several as a dataclass or a tuple; None: unknown
UNITS = {"_m": "m", "_rad": "rad"}  # units of keys with these endings


@dataclass(frozen=True)
class Column(Head):
    """Column of a metric: its places from the left in the tables of a run, a study and a sweep; None: not there.

    Columns `of_bounds` are only in tables with a bound.
    """

    run: int | None = None
    study: int | None = None
    sweep: int | None = None
    of_bounds: bool = False


@dataclass(frozen=True)
class Metric:
    """A figure of an estimate, or of an estimator over many runs."""

    key: str  # in metrics.json, summary.json and the store of a study
    help: str  # a sentence
    measure: Measure | None = None  # None: not in metrics.json
    over_runs: OverRuns | None = None  # None: not in summary.json
    stored: bool = False  # by studies, for every run
    column: Column | None = None  # in tables

    @property
    def unit(self) -> str:
        """`m`, `rad`, `s`, or nothing."""
        return "s" if self.key.startswith("seconds") else UNITS.get(self.key[self.key.rfind("_") :], "")


def _of_run(key: str, text: str, measure: Measure, column: Column | None = None) -> Metric:
    return Metric(key, text, measure, column=column)


def _of_study(key: str, text: str, over_runs: OverRuns, column: Column | None = None) -> Metric:
    return Metric(key, text, over_runs=over_runs, column=column)


def _stored(key: str, text: str, measure: Measure, column: Column | None = None) -> Metric:
    """Return a metric of runs that studies store and do not average."""
    return Metric(key, text, measure, stored=True, column=column)


def _averaged(key: str, text: str, measure: Measure, column: Column | None = None) -> Metric:
    """Return a metric of runs that studies store and average."""
    return Metric(key, text, measure, mean_of(key), stored=True, column=column)


def _final_distance_to_batch(found: Measured) -> float | None:
    if found.batch is None:
        return None
    return number(math.dist(found.estimate.poses[found.last, :2], found.batch.poses[found.last, :2]))


def _half_map(found: Measured, *, what: str, half: str) -> float | None:
    values = found.map_sigmas if what == "sigma" else distances(found.map_errors)
    return rms(values[found.halves[half == "far"]])


CATALOGUE = (
    _averaged(
        "ate_m",
        "RMS position error over the poses with truth, without alignment",
        lambda found: rms(found.off),
        Column("ATE [m]", run=1, study=1, sweep=1),
    ),
    _of_study(
        "position_rmse_m",
        "mean over steps of the RMS position error over runs (as in the literature)",
        mean_root_of("error_x", "error_y"),
        Column("RMSE [m]", study=2, sweep=2, of_bounds=True),
    ),
    Metric(
        "heading_rmse_rad",
        "RMS heading error; in studies, mean over steps of the RMS over runs",
        lambda found: rms(found.errors[:, 2]),
        mean_root_of("error_heading"),
        column=Column("heading [rad]", "heading error [rad]", form="{:.4f}", run=6, study=8),
    ),
    _averaged(
        "final_position_error_m",
        "position error of the last pose",
        lambda found: number(found.off[found.last]),
        Column("end [m]", "final position error [m]", run=7, study=9),
    ),
    _of_run(
        "rpe_m",
        "RMS translation error of single steps, in the body frame",
        lambda found: rms(step_errors(found.reference, found.estimate.poses)),
    ),
    _of_run(
        "nees_pose",
        "mean over time of the pose NEES: about 3 if the estimate is consistent",
        lambda found: mean(found.nees),
        Column("NEES", form="{:.2f}", run=3),
    ),
    _of_run(
        "nees_position",
        "mean over time of the position NEES: about 2 if the estimate is consistent (a column if headings are unknown)",
        lambda found: mean(found.nees_position),
        Column("NEES xy", form="{:.2f}", run=3),
    ),
    _of_study(
        "nees_pose_per_dof",
        "mean over runs and steps from the 11th on of the pose NEES over 3",
        late_mean_of("nees_pose", 3),
        Column("NEES/3", form="{:.2f}", study=5, sweep=5),
    ),
    _of_study(
        "nees_position_per_dof",
        "mean over runs and steps from the 11th on of the position NEES over 2",
        late_mean_of("nees_position", 2),
    ),
    _of_study(
        "nees_heading", "mean over runs and steps from the 11th on of the heading NEES", late_mean_of("nees_heading", 1)
    ),
    _of_study(
        "nees_share_inside_band",
        "share of steps whose mean pose NEES over runs is in its chi-square band",
        share_inside_band,
        Column(f"NEES in {BAND_LEVEL:.1%} band", form="{:.1%}", study=14),
    ),
    Metric(
        "coverage_95",
        "share of the positions inside their 95 % ellipses; in studies from the 11th step on",
        lambda found: mean(is_inside(found.nees_position, 0.95)),
        late_coverage,
        column=Column("in 95% ellipse", form="{:.1%}", run=4, study=6),
    ),
    Metric(
        "nis_per_dof",
        "NIS over its degrees of freedom: about 1 if the assumed noise is right",
        lambda found: found.nis_per_dof,
        total_nis,
        column=Column("NIS/dof", run=5, study=7),
    ),
    _stored("nis_total", "sum of the NIS of all steps", lambda found: found.nis_total),
    _stored("nis_dof_total", "degrees of freedom of the NIS of all steps", lambda found: found.nis_dof_total),
    _averaged(
        "landmark_rmse_m",
        "RMS distance of the mapped landmarks from the true ones, at the end",
        lambda found: rms(distances(found.map_errors)),
        Column("map [m]", "map error [m]", run=9),
    ),
    _averaged(
        "landmark_nees_per_dof",
        "mean NEES of the mapped landmarks over its 2 degrees of freedom",
        lambda found: mean(found.map_nees / 2),
        Column("map NEES/2", "landmark NEES/2", form="{:.2f}", study=10),
    ),
    *(
        _stored(
            f"landmark_{what}_{half}_m",
            f"RMS {what} of the half of the map that is {place} the start",
            partial(_half_map, what=what, half=half),
        )
        for what in ("sigma", "error")
        for half, place in (("near", "nearer to"), ("far", "farther from"))
    ),
    _averaged(
        "landmarks_mapped",
        "number of landmarks in the map",
        lambda found: len(found.estimate.landmark_ids),
        Column("mapped", "mapped landmarks", form="{:.1f}", run=10, study=12, sweep=7),
    ),
    _stored(
        "landmarks_true",
        "number of distinct landmarks that were observed",
        lambda found: None if found.observed is None else len(found.observed),
        Column("of", "true landmarks", run=11),
    ),
    _averaged(
        "landmarks_missed",
        "number of observed landmarks without a counterpart in the map",
        lambda found: found.missed,
    ),
    _averaged(
        "wrong_associations",
        "number of observations that are assigned to another landmark than their own",
        lambda found: None if found.wrong is None else int(found.wrong.sum()),
        Column("wrong", "wrong associations", form="{:.1f}", run=8, study=11, sweep=8),
    ),
    Metric(
        "rays",
        "result of the rays of a bearing-only estimate (`ray_figures.RayFigures`)",
        ray_figures,
        mean_rays,
    ),
    Metric(
        "ratio_to_optimum",
        "ATE over that of the optimum of the same kind, paired run by run",
        optimum_notes.ratio_to_optimum,
        over_optimum(),
        column=Column("x optimum", form="{:.2f}", run=2, relative=True),
    ),
    _of_study(
        "ratio_to_causal",
        "ATE over that of the causal optimum",
        over_optimum(CAUSAL),
        Column("x causal", study=3, sweep=3, relative=True),
    ),
    _of_study(
        "ratio_to_bound",
        "`position_rmse_m` over that of the Cramer-Rao bound of the same kind, over the same runs",
        over_bound,
        Column("x bound", study=4, sweep=4, of_bounds=True),
    ),
    _of_study(
        "position_sigma_m",
        "RMS position sigma that the estimator reports",
        lambda runs, _: mean_interval(reported_sigma(runs)),
        Column("sigma [m]", "reported position sigma [m]", sweep=6),
    ),
    _of_run(
        "mahalanobis_to_optimum",
        "mean over time of the squared Mahalanobis distance to the optimum, under its covariance",
        optimum_notes.mahalanobis_to_optimum,
        Column("d to optimum", "Mahalanobis distance² to the optimum", form="{:.3g}", run=12, relative=True),
    ),
    _of_run(
        "final_distance_to_batch_m",
        "distance of the last position from batch's",
        _final_distance_to_batch,
        Column("end to batch [m]", "final distance to batch [m]", run=13),
    ),
    _stored(
        "optimum_check_sigma",
        "distance of a causal optimum's last pose and sigmas from the hindsight optimum's, in sigmas of the latter",
        lambda found: found.estimate.optimum_check,
    ),
    _of_run(
        "yardstick_check_sigma",
        "`optimum_check_sigma` of the optimum with which the estimate is compared",
        lambda found: None if found.optimum is None else found.optimum.optimum_check,
    ),
    _of_study(
        "optimum_check_share",
        f"share of the runs in which the optimum's check is above {optimum_notes.CHECK_LIMIT:g} sigma",
        lambda runs, _: optimum_notes.share_of_doubt(runs.figures["optimum_check_sigma"]),
    ),
    _averaged(
        "chi_square_per_dof",
        "squared residuals of an optimum over their degrees of freedom: about 1 if the stated noise is right",
        lambda found: optimum_notes.chi_square_per_dof(found.estimate),
    ),
    Metric(
        "verdict",
        "conclusions from the figures, in words (`verdicts`)",
        verdicts.verdict_on_run,
        verdicts.verdict_over_runs,
    ),
    _of_study("faults", "faults in a few words, without sizes (`verdicts`)", verdicts.faults_over_runs),
    _of_run("loop_closure", "one entry per loop closure (`measured.LoopClosure`)", lambda found: found.loop_closures),
    Metric(
        "seconds_total",
        "computing time",
        lambda found: None if found.estimate.seconds is None else float(found.estimate.seconds.sum()),
        lambda runs, _: mean(runs.figures["seconds_total"]),
        stored=True,
        column=Column("time [s]", "computing time [s]", form="{:.2f}", run=14),
    ),
)
BY_KEY = {each.key: each for each in CATALOGUE}
STORED = (*(each.key for each in CATALOGUE if each.stored), *(f"rays_{name}" for name in RAY_FIGURES))


def measured(found: Measured, *, in_study: bool = False) -> dict[str, Any]:
    """Return the metrics of an estimate by key: all of a score, or those that studies store."""
    figures = {
        each.key: each.measure(found)
        for each in CATALOGUE
        if each.measure is not None and (each.stored or not in_study)
    }
    if not in_study:
        return figures
    rays = ray_figures(found)
    return figures | {f"rays_{name}": getattr(rays, name, None) for name in RAY_FIGURES}


# --- columns -------------------------------------------------------------------------------------


def heads(table: TableName, *, bounded: bool = False) -> list[Column]:
    """Return the columns of metrics in a table, from the left; with those of bounds if `bounded`."""
    columns = [replace(each.column, key=each.key, help=each.help) for each in CATALOGUE if each.column is not None]
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
        is_relative = head.relative and is_marked is not None
        cells.append(marked(found, MARK, is_marked=bool(is_marked)) if is_relative else found)
    return cells


def empty_columns(columns: Sequence[Head], is_empty: Callable[[str], bool]) -> list[str]:
    """Return a line that names the columns without any figure; no line if every column has one."""
    names = [head.full for head in columns if is_empty(head.key)]
    return [f"Empty columns: {', '.join(names)} (docs/your_filter.md lists what each needs)"] if names else []
