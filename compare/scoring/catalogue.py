"""List of all metrics. A new metric needs an entry here and the function that computes it.

`Score` (a run) and `EstimatorSummary` (a study) are dataclasses with typed fields in the order of the files. Metrics
with a `measure` need no field: they are in `others`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from slamgauge.compare.estimators.registry import CAUSAL, HINDSIGHT
from slamgauge.compare.scoring import optimum_figures, verdicts
from slamgauge.compare.scoring.aggregation import (
    OverRuns,
    excess_over,
    final_sigma_ratio,
    late_coverage,
    late_mean_of,
    mean_of,
    mean_rays,
    mean_root_of,
    over_bound,
    over_optimum,
    reported_sigma,
    share_in_doubt,
    share_inside_band,
    total_nis,
)
from slamgauge.compare.scoring.consistency import coverage, log_score
from slamgauge.compare.scoring.intervals import mean_interval
from slamgauge.compare.scoring.metric import Column, Measure, Metric, Table
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.ray_figures import RayFigures
from slamgauge.compare.scoring.trajectory_error import relative_errors
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


def _of_run(key: str, text: str, column: Column | None = None, measure: Measure | None = None) -> Metric:
    return Metric(key, text, scored=True, column=column, measure=measure)


def _of_study(key: str, text: str, over_runs: OverRuns, column: Column | None = None) -> Metric:
    return Metric(key, text, over_runs=over_runs, column=column)


def _of_both(key: str, text: str, over_runs: OverRuns, column: Column | None = None) -> Metric:
    return Metric(key, text, scored=True, over_runs=over_runs, column=column)


def _averaged(key: str, text: str, column: Column | None = None, measure: Measure | None = None) -> Metric:
    """Return a metric of runs that studies store and average."""
    return Metric(key, text, scored=True, stored=True, over_runs=mean_of(key), column=column, measure=measure)


def _coverage(percent: int, column: Column | None = None) -> Metric:
    text = f"share of the positions inside their {percent} % ellipses; in studies from the 11th step on"
    metric = _of_both(f"coverage_{percent}", text, late_coverage(percent / 100), column)
    return replace(metric, measure=coverage(percent / 100))


CATALOGUE = (
    _averaged(
        "ate_m",
        "RMS position error over the poses with truth, without alignment",
        Column("ATE [m]", run=1, study=1, sweep=1),
    ),
    _of_run("ate_aligned_m", "RMS position error after the best rigid motion in SE(2)"),
    _of_study(
        "position_rmse_m",
        "mean over steps of the RMS position error over runs (as in the literature)",
        mean_root_of("error_x", "error_y"),
        Column("RMSE [m]", study=2, sweep=2, of_bounds=True),
    ),
    _of_both(
        "heading_rmse_rad",
        "RMS heading error; in studies, mean over steps of the RMS over runs",
        mean_root_of("error_heading"),
        Column("heading [rad]", "heading error [rad]", "{:.4f}", run=6, study=9),
    ),
    _averaged(
        "final_position_error_m",
        "position error of the last pose",
        Column("end [m]", "final position error [m]", run=7, study=10),
    ),
    _of_run("final_heading_error_rad", "absolute heading error of the last pose"),
    _of_run("rpe_m", "RMS translation error of single steps, in the body frame"),
    _of_run(
        "rpe_by_distance",
        "relative pose errors over segments of the path, by their length (`trajectory_error.RelativeError`)",
        measure=relative_errors,
    ),
    _of_run(
        "nees_pose",
        "mean over time of the pose NEES: about 3 if the estimate is consistent",
        Column("NEES", form="{:.2f}", run=3),
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
    ),
    _coverage(50),
    _coverage(95, Column("in 95% ellipse", form="{:.1%}", run=4, study=6)),
    _coverage(99),
    _averaged(
        "log_score",
        "log score: mean over time of -log p of the true pose [m, m, rad] under the estimate's Gaussian [nats]",
        measure=log_score,
    ),
    _of_both(
        "nis_per_dof",
        "NIS over its degrees of freedom: about 1 if the assumed noise is right",
        total_nis,
        Column("NIS/dof", run=5, study=8),
    ),
    Metric("nis_total", "sum of the NIS of all steps", stored=True),
    Metric("nis_dof_total", "degrees of freedom of the NIS of all steps", stored=True),
    _averaged(
        "landmark_rmse_m",
        "RMS distance of the mapped landmarks from the true ones, at the end",
        Column("map [m]", "map error [m]", run=9),
    ),
    _averaged(
        "landmark_nees_per_dof",
        "mean NEES of the mapped landmarks over its 2 degrees of freedom",
        Column("map NEES/2", "landmark NEES/2", "{:.2f}", study=12),
    ),
    Metric("landmark_sigma_near_m", "RMS sigma of the half of the map that is nearer to the start", stored=True),
    Metric("landmark_sigma_far_m", "RMS sigma of the farther half of the map", stored=True),
    Metric("landmark_error_near_m", "RMS error of the nearer half of the map", stored=True),
    Metric("landmark_error_far_m", "RMS error of the farther half of the map", stored=True),
    Metric("observations", "number of observations", stored=True),
    _averaged(
        "landmarks_mapped",
        "number of landmarks in the map",
        Column("mapped", "mapped landmarks", "{:d}", "{:.1f}", run=10, study=14, sweep=7),
    ),
    Metric(
        "landmarks_true",
        "number of distinct landmarks that were observed",
        scored=True,
        stored=True,
        column=Column("of", "true landmarks", "{:d}", run=11),
    ),
    _averaged("landmarks_missed", "number of observed landmarks without a counterpart in the map"),
    _averaged("landmarks_spurious", "number of mapped landmarks without a true counterpart, duplicates included"),
    _averaged(
        "wrong_associations",
        "number of observations that are assigned to another landmark than their own",
        Column("wrong", "wrong associations", "{:d}", "{:.1f}", run=8, study=13, sweep=8),
    ),
    Metric(
        "observations_rejected", "number of observations that are assigned to no landmark", scored=True, stored=True
    ),
    Metric(
        "track_purity",
        "mean over tracks of the largest share of their observations that come from one landmark",
        scored=True,
        stored=True,
    ),
    _of_run("track_purity_min", "smallest such share of a track"),
    _of_both("rays", "result of the rays of a bearing-only estimate (`ray_figures.RayFigures`)", mean_rays),
    _of_both(
        "ratio_to_optimum",
        "ATE over that of the optimum of the same kind, paired run by run",
        over_optimum(),
        Column("x optimum", form="{:.2f}", run=2, relative=True),
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
        "ratio_to_hindsight",
        "ATE over that of the hindsight optimum",
        over_optimum(HINDSIGHT),
        Column("x hindsight", study=7),
    ),
    _of_study(
        "position_sigma_m",
        "RMS position sigma that the estimator reports",
        lambda runs, _: mean_interval(reported_sigma(runs)),
        Column("sigma [m]", "reported position sigma [m]", sweep=6),
    ),
    _of_run("sigma_ratio_to_optimum", "mean over time of sigma over the optimum's, for x, y and heading"),
    _of_study(
        "sigma_ratio_to_optimum_final",
        "mean over runs of the last sigma over the optimum's, for x, y and heading",
        final_sigma_ratio,
    ),
    _of_run(
        "mahalanobis_to_optimum",
        "mean over time of the squared Mahalanobis distance to the optimum, under its covariance",
        Column("d to optimum", "Mahalanobis distance² to the optimum", "{:.3g}", run=12, relative=True),
    ),
    _of_run(
        "log_score_to_optimum",
        "log score minus that of the optimum of the same kind at the same steps [nats]: 0 is as good, more is worse",
        Column("log score to optimum", "log-score difference to the optimum [nats]", "{:.2f}", run=13, relative=True),
    ),
    _of_study(
        "log_score_to_causal",
        "log score minus that of the causal optimum [nats], paired run by run",
        excess_over("log_score", CAUSAL),
        Column(
            "log score to causal",
            "log-score difference to the causal optimum [nats]",
            "{:.2f}",
            study=11,
            relative=True,
        ),
    ),
    _of_run(
        "final_distance_to_batch_m",
        "distance of the last position from batch's",
        Column("end to batch [m]", "final distance to batch [m]", run=14),
    ),
    _of_run("landmark_distance_to_batch_m", "RMS distance of the landmarks from batch's"),
    Metric(
        "optimum_check_sigma",
        "distance of a causal optimum's last pose and sigmas from the hindsight optimum's, in sigmas of the latter",
        scored=True,
        stored=True,
        measure=optimum_figures.check_sigma,
    ),
    _of_run("yardstick_check_sigma", "`optimum_check_sigma` of the optimum with which the estimate is compared"),
    _of_study(
        "optimum_check_share",
        f"share of the runs in which the optimum's check is above {optimum_figures.CHECK_LIMIT:g} sigma",
        share_in_doubt,
    ),
    _averaged(
        "chi_square_per_dof",
        "squared residuals of an optimum over their degrees of freedom: about 1 if the stated noise is right",
        measure=optimum_figures.chi_square_per_dof,
    ),
    _of_run(
        "observations_left_out",
        "number of observations that an optimum leaves out, because they do not place a landmark",
        measure=optimum_figures.observations_left_out,
    ),
    _of_both("verdict", "conclusions from the figures, in words (`verdicts`)", verdicts.verdict_over_runs),
    _of_study("faults", "faults in a few words, without sizes (`verdicts`)", verdicts.faults_over_runs),
    _of_run("loop_closure", "one entry per loop closure (`loop_closures.LoopClosure`)"),
    Metric(
        "seconds_total",
        "computing time",
        scored=True,
        stored=True,
        over_runs=lambda runs, _: mean(runs.figures["seconds_total"]),
        column=Column("time [s]", "computing time [s]", "{:.2f}", run=15),
    ),
    _of_run("seconds_per_step_median", "median over the steps of the computing time"),
)
SCORED = frozenset(each.key for each in CATALOGUE if each.scored)
STORED = (*(each.key for each in CATALOGUE if each.stored), *(f"rays_{name}" for name in RayFigures._fields))
RELATIVE = frozenset(each.key for each in CATALOGUE if each.column is not None and each.column.relative)
SUMMED_UP = {each.key: each.over_runs for each in CATALOGUE if each.over_runs is not None}
FULL_NAMES = {each.column.title: each.column.name or each.column.title for each in CATALOGUE if each.column is not None}


def columns(table: Table, *, bounded: bool = False) -> list[tuple[str, str, str]]:
    """Return title, key and format of the columns of a table, from the left; with those of bounds if `bounded`."""
    found: list[tuple[int, tuple[str, str, str]]] = []
    for each in CATALOGUE:
        column = each.column
        place = None if column is None else getattr(column, table)
        if column is not None and place is not None and (bounded or not column.of_bounds):
            form = column.form if table == "run" else column.mean_form or column.form
            found.append((place, (column.title, each.key, form)))
    return [head for _, head in sorted(found)]


def empty_columns(table: Table, is_empty: Callable[[str], bool], *, bounded: bool = False) -> list[str]:
    """Return a line that names the columns of a table without any figure; no line if every column has one.

    Args:
        table: kind of table.
        is_empty: whether the metric with a key has no figure.
        bounded: whether the table has the columns of bounds.
    """
    names = [FULL_NAMES.get(title, title) for title, key, _ in columns(table, bounded=bounded) if is_empty(key)]
    return [f"Empty columns: {', '.join(names)} (docs/your_filter.md lists what each needs)"] if names else []


def measured(truth: Truth, recording: Recording, estimate: Estimate, *, in_study: bool = False) -> dict[str, Any]:
    """Return the metrics that have a `measure`: those of a score, or of a run in a study, which has no others."""
    return {
        each.key: each.measure(truth, recording, estimate)
        for each in CATALOGUE
        if each.measure is not None and (each.stored if in_study else each.scored)
    }
