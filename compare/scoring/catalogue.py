"""All that is said of a figure, once: to add a score is a file that measures it and an entry here.

`Score` (of a run) and `EstimatorSummary` (of a study) are dataclasses, so that what is there is typed, in the order in
which files have it; a figure that they have no field for, one with a `measure`, follows in their `others`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from slamgauge.compare.estimators.registry import CAUSAL, HINDSIGHT
from slamgauge.compare.scoring import coverage, optimum_figures, verdicts
from slamgauge.compare.scoring.aggregation import (
    excess_over,
    final_sigma_ratio,
    late_coverage,
    late_mean_of,
    mean_of,
    mean_rays,
    mean_root_of,
    over_bound,
    over_optimum,
    plain_mean_of,
    position_sigma,
    share_in_doubt,
    share_inside_band,
    total_nis,
)
from slamgauge.compare.scoring.metric import Column, Quantity, Table
from slamgauge.compare.scoring.ray_figures import RayFigures
from slamgauge.compare.scoring.relative_error import relative_errors
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

CATALOGUE = (
    Quantity(
        key="ate_m",
        unit="m",
        help="RMS position error over the poses with truth, without alignment",
        scored=True,
        stored=True,
        over_runs=mean_of("ate_m"),
        column=Column(title="ATE [m]", run=1, study=1, sweep=1),
    ),
    Quantity(key="ate_aligned_m", unit="m", help="the same after the best rigid motion in SE(2)", scored=True),
    Quantity(
        key="position_rmse_m",
        unit="m",
        help="mean over steps of the RMS position error over runs (the literature's)",
        over_runs=mean_root_of("error_x", "error_y"),
        column=Column(title="RMSE [m]", study=2, sweep=2, of_bounds=True),
    ),
    Quantity(
        key="heading_rmse_rad",
        unit="rad",
        help="RMS heading error; of a study, mean over steps of the RMS over runs",
        scored=True,
        over_runs=mean_root_of("error_heading"),
        column=Column(title="heading [rad]", form="{:.4f}", run=6, study=9),
    ),
    Quantity(
        key="final_position_error_m",
        unit="m",
        help="position error of the last pose",
        scored=True,
        stored=True,
        over_runs=mean_of("final_position_error_m"),
        column=Column(title="end [m]", run=7, study=10),
    ),
    Quantity(key="final_heading_error_rad", unit="rad", help="absolute heading error of the last pose", scored=True),
    Quantity(key="rpe_m", unit="m", help="RMS translation error of single steps, in the body frame", scored=True),
    Quantity(
        key="rpe_by_distance",
        help="the same over pieces of the path, by their length (`relative_error.RelativeError`)",
        scored=True,
        measure=relative_errors,
    ),
    Quantity(
        key="nees_pose",
        help="mean over time of the pose NEES; a consistent estimate reads about 3",
        scored=True,
        column=Column(title="NEES", form="{:.2f}", run=3),
    ),
    Quantity(
        key="nees_pose_per_dof",
        help="mean over runs and steps from the 11th on of the pose NEES over 3",
        over_runs=late_mean_of("nees_pose", 3),
        column=Column(title="NEES/3", form="{:.2f}", study=5, sweep=5),
    ),
    Quantity(
        key="nees_position_per_dof", help="likewise of the position, over 2", over_runs=late_mean_of("nees_position", 2)
    ),
    Quantity(key="nees_heading", help="likewise of the heading", over_runs=late_mean_of("nees_heading", 1)),
    Quantity(
        key="nees_share_inside_band",
        help="share of steps whose mean pose NEES over runs lies in its chi-square band",
        over_runs=share_inside_band,
    ),
    Quantity(
        key="coverage_50",
        help="share of the positions inside their 50 % ellipses; of a study, from the 11th step on",
        scored=True,
        measure=coverage.coverage_50,
        over_runs=late_coverage(0.5),
    ),
    Quantity(
        key="coverage_95",
        help="share of the positions inside their 95 % ellipses; of a study, from the 11th step on",
        scored=True,
        measure=coverage.coverage_95,
        over_runs=late_coverage(0.95),
        column=Column(title="in 95% ellipse", form="{:.1%}", run=4, study=6),
    ),
    Quantity(
        key="coverage_99",
        help="share of the positions inside their 99 % ellipses; of a study, from the 11th step on",
        scored=True,
        measure=coverage.coverage_99,
        over_runs=late_coverage(0.99),
    ),
    Quantity(
        key="log_score",
        help="mean over time of -log p of the true pose [m, m, rad] under the estimate's Gaussian, in nats per step",
        scored=True,
        stored=True,
        measure=coverage.log_score,
        over_runs=mean_of("log_score"),
    ),
    Quantity(
        key="nis_per_dof",
        help="NIS over its degrees of freedom; a filter that knows its noise reads about 1",
        scored=True,
        over_runs=total_nis,
        column=Column(title="NIS/dof", run=5, study=8),
    ),
    Quantity(key="nis_total", help="sum of the NIS of all steps", stored=True),
    Quantity(key="nis_dof_total", help="its degrees of freedom", stored=True),
    Quantity(
        key="landmark_rmse_m",
        unit="m",
        help="RMS distance of the mapped landmarks from the true ones, at the end",
        scored=True,
        stored=True,
        over_runs=mean_of("landmark_rmse_m"),
        column=Column(title="map [m]", run=9),
    ),
    Quantity(
        key="landmark_nees_per_dof",
        help="mean NEES of the mapped landmarks over its 2 degrees of freedom",
        scored=True,
        stored=True,
        over_runs=mean_of("landmark_nees_per_dof"),
        column=Column(title="map NEES/2", form="{:.2f}", study=12),
    ),
    Quantity(
        key="landmark_sigma_near_m",
        unit="m",
        help="RMS sigma of the half of the mapped landmarks that is nearer to the start",
        stored=True,
    ),
    Quantity(key="landmark_sigma_far_m", unit="m", help="RMS sigma of the other half", stored=True),
    Quantity(key="landmark_error_near_m", unit="m", help="RMS error of the nearer half", stored=True),
    Quantity(key="landmark_error_far_m", unit="m", help="RMS error of the other half", stored=True),
    Quantity(key="observations", help="number of observations", stored=True),
    Quantity(
        key="landmarks_mapped",
        help="number of landmarks in the map",
        scored=True,
        stored=True,
        over_runs=mean_of("landmarks_mapped"),
        column=Column(title="mapped", form="{:d}", mean_form="{:.1f}", run=10, study=14, sweep=7),
    ),
    Quantity(
        key="landmarks_true",
        help="number of distinct landmarks that were observed",
        scored=True,
        stored=True,
        column=Column(title="of", form="{:d}", run=11),
    ),
    Quantity(
        key="landmarks_missed",
        help="observed landmarks that no mapped one stands for",
        scored=True,
        stored=True,
        over_runs=mean_of("landmarks_missed"),
    ),
    Quantity(
        key="landmarks_spurious",
        help="mapped landmarks that stand for none, doubles among them",
        scored=True,
        stored=True,
        over_runs=mean_of("landmarks_spurious"),
    ),
    Quantity(
        key="wrong_associations",
        help="number of observations given to another landmark than their own",
        scored=True,
        stored=True,
        over_runs=mean_of("wrong_associations"),
        column=Column(title="wrong", form="{:d}", mean_form="{:.1f}", run=8, study=13, sweep=8),
    ),
    Quantity(key="observations_rejected", help="number of observations given to none", scored=True, stored=True),
    Quantity(
        key="track_purity",
        help="mean over tracks of the largest share of their observations that come from one landmark",
        scored=True,
        stored=True,
    ),
    Quantity(key="track_purity_min", help="that share of the least pure track", scored=True),
    Quantity(
        key="rays",
        help="what became of the rays of a bearing-only estimate (`ray_figures.RayFigures`)",
        scored=True,
        over_runs=mean_rays,
    ),
    Quantity(
        key="ratio_to_optimum",
        help="ATE over that of the optimum of the same kind, paired run by run",
        scored=True,
        over_runs=over_optimum(),
        column=Column(title="x optimum", form="{:.2f}", run=2, relative=True),
    ),
    Quantity(
        key="ratio_to_causal",
        help="ATE over that of the causal optimum",
        over_runs=over_optimum(CAUSAL),
        column=Column(title="x causal", study=3, sweep=3, relative=True),
    ),
    Quantity(
        key="ratio_to_bound",
        help="`position_rmse_m` over that of the Cramer-Rao bound of the same kind, over the same runs",
        over_runs=over_bound,
        column=Column(title="x bound", study=4, sweep=4, of_bounds=True),
    ),
    Quantity(
        key="ratio_to_hindsight",
        help="ATE over that of the hindsight optimum",
        over_runs=over_optimum(HINDSIGHT),
        column=Column(title="x hindsight", study=7),
    ),
    Quantity(
        key="position_sigma_m",
        unit="m",
        help="RMS position sigma that the estimator reports",
        over_runs=position_sigma,
        column=Column(title="sigma [m]", sweep=6),
    ),
    Quantity(
        key="sigma_ratio_to_optimum",
        help="mean over time of sigma over the optimum's, for x, y and heading",
        scored=True,
    ),
    Quantity(
        key="sigma_ratio_to_optimum_final",
        help="mean over runs of the last sigma over the optimum's, for x, y and heading",
        over_runs=final_sigma_ratio,
    ),
    Quantity(
        key="mahalanobis_to_optimum",
        help="mean over time of the squared Mahalanobis distance to the optimum, under its covariance",
        scored=True,
        column=Column(title="d to optimum", form="{:.3g}", run=12, relative=True),
    ),
    Quantity(
        key="log_score_to_optimum",
        help="log score less that of the optimum of the same kind at the same steps; 0 is as good, more is worse",
        scored=True,
        column=Column(title="nats to optimum", form="{:.2f}", run=13, relative=True),
    ),
    Quantity(
        key="log_score_to_causal",
        help="log score less that of the causal optimum, paired run by run",
        over_runs=excess_over("log_score", CAUSAL),
        column=Column(title="nats to causal", form="{:.2f}", study=11, relative=True),
    ),
    Quantity(
        key="final_distance_to_batch_m",
        unit="m",
        help="distance of the last position from batch's",
        scored=True,
        column=Column(title="end to batch [m]", run=14),
    ),
    Quantity(
        key="landmark_distance_to_batch_m", unit="m", help="RMS distance of the landmarks from batch's", scored=True
    ),
    Quantity(
        key="optimum_check_sigma",
        help="of a causal optimum, how far its last pose and sigmas are from the hindsight optimum's, in sigmas of it",
        scored=True,
        stored=True,
        measure=optimum_figures.check_sigma,
    ),
    Quantity(
        key="yardstick_check_sigma", help="that figure of the optimum which the estimate is held against", scored=True
    ),
    Quantity(
        key="optimum_check_share",
        help=f"share of the runs in which the optimum's is more than {optimum_figures.CHECK_LIMIT:g} sigma",
        over_runs=share_in_doubt,
    ),
    Quantity(
        key="chi_square_per_dof",
        help="of an optimum, its squared residuals over their degrees of freedom; noise that is stated rightly reads 1",
        scored=True,
        stored=True,
        over_runs=mean_of("chi_square_per_dof"),
        measure=optimum_figures.chi_square_per_dof,
    ),
    Quantity(
        key="observations_left_out",
        help="of an optimum, number of observations of landmarks that they do not place (`observations_rejected`)",
        scored=True,
        measure=optimum_figures.observations_left_out,
    ),
    Quantity(
        key="verdict",
        help="what the figures say, in words (`verdicts`)",
        scored=True,
        over_runs=verdicts.verdict_over_runs,
    ),
    Quantity(
        key="faults",
        help="what of it is wrong, a few words each without sizes (`verdicts`)",
        over_runs=verdicts.faults_over_runs,
    ),
    Quantity(key="loop_closure", help="one entry per loop closure (`loop_closures.LoopClosure`)", scored=True),
    Quantity(
        key="seconds_total",
        unit="s",
        help="computing time",
        scored=True,
        stored=True,
        over_runs=plain_mean_of("seconds_total"),
        column=Column(title="time [s]", form="{:.2f}", run=15),
    ),
    Quantity(key="seconds_per_step_median", unit="s", help="its median over the steps", scored=True),
)
SCORED = frozenset(each.key for each in CATALOGUE if each.scored)
STORED = (*(each.key for each in CATALOGUE if each.stored), *(f"rays_{name}" for name in RayFigures._fields))
RELATIVE = frozenset(each.key for each in CATALOGUE if each.column is not None and each.column.relative)
SUMMED_UP = {each.key: each.over_runs for each in CATALOGUE if each.over_runs is not None}


def columns(table: Table, *, bounded: bool = False) -> list[tuple[str, str, str]]:
    """Title, key and form of the columns of a table, from the left; with those of bounds if it is `bounded`."""
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
        table: which one.
        is_empty: whether a key has no figure.
        bounded: whether the table has the columns of bounds.
    """
    titles = [title for title, key, _ in columns(table, bounded=bounded) if is_empty(key)]
    return [f"empty: {', '.join(titles)} (docs/your_filter.md has what each column needs)"] if titles else []


def measured(truth: Truth, recording: Recording, estimate: Estimate) -> dict[str, Any]:
    """The figures that come with a `measure`."""
    return {each.key: each.measure(truth, recording, estimate) for each in CATALOGUE if each.measure is not None}
