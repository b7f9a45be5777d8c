"""The summary of a study: means over runs with 95 % intervals, paired ratios, consistency at every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.registry import CAUSAL, HINDSIGHT, YARDSTICKS
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.defined import mean
from slamgauge.compare.scoring.intervals import Interval, jackknife_interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.ray_figures import RayFigures, describe, mean_figures
from slamgauge.compare.scoring.text_table import aligned, interval_cell
from slamgauge.compare.studies.store import Runs

BAND_LEVEL = 0.999  # of the chi-square band whose share of steps is given
FIRST_STEP = 11  # NEES means leave the first steps out, where the start still shows


@dataclass(frozen=True, kw_only=True)
class EstimatorSummary:
    """What a study says of one estimator; a figure that does not apply is None.

    Attributes:
        kind: `filtered` or `smoothed`; None if every run failed.
        runs: how many did not fail.
        ate_m: mean over runs of the RMS position error over the path.
        position_rmse_m: mean over steps of the RMS over runs (the literature's).
        heading_rmse_rad: the same of the heading.
        final_position_error_m: of the last pose.
        nis_per_dof: NIS over its degrees of freedom.
        landmark_rmse_m: of the final map.
        landmark_nees_per_dof: of the final map.
        nees_pose_per_dof: mean over runs and steps from the 11th on; likewise position and heading.
        ratio_to_optimum: mean ATE over that of the optimum of the same kind, paired run by run.
        ratio_to_causal: over iSAM2's.
        ratio_to_hindsight: over batch's.
        position_sigma_m: mean over runs of the RMS position sigma that the estimator reports.
        wrong_associations: per run.
        landmarks_mapped: per run; likewise those missed and the spurious ones.
        nees_share_inside_band: share of steps whose mean pose NEES over runs lies in its chi-square band.
        sigma_ratio_to_optimum_final: mean over runs of the last sigma over the optimum's: x, y, heading.
        rays: what became of the rays of a bearing-only estimator, means over runs (`ray_figures.RayFigures`).
        seconds_total: mean over runs.
    """

    kind: str | None
    runs: int
    ate_m: Interval | None
    position_rmse_m: Interval | None
    heading_rmse_rad: Interval | None
    final_position_error_m: Interval | None
    nis_per_dof: Interval | None
    landmark_rmse_m: Interval | None
    landmark_nees_per_dof: Interval | None
    nees_pose_per_dof: Interval | None
    nees_position_per_dof: Interval | None
    nees_heading: Interval | None
    ratio_to_optimum: Interval | None
    ratio_to_causal: Interval | None
    ratio_to_hindsight: Interval | None
    position_sigma_m: Interval | None
    wrong_associations: Interval | None
    landmarks_mapped: Interval | None
    landmarks_missed: Interval | None
    landmarks_spurious: Interval | None
    nees_share_inside_band: float | None
    sigma_ratio_to_optimum_final: tuple[float | None, ...] | None
    rays: RayFigures | None
    seconds_total: float | None

    def to_json(self) -> dict[str, Any]:
        """The estimator's entry in summary.json; `rays` only where there are any."""
        entry: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        entry = {key: value._asdict() if isinstance(value, Interval) else value for key, value in entry.items()}
        if self.nees_share_inside_band is not None:
            entry["nees_share_inside_band"] = {"level": BAND_LEVEL, "share": self.nees_share_inside_band}
        if self.sigma_ratio_to_optimum_final is not None:
            entry["sigma_ratio_to_optimum_final"] = list(self.sigma_ratio_to_optimum_final)
        if self.rays is None:
            del entry["rays"]
        else:
            entry["rays"] = self.rays._asdict()
        entry["seconds_total"] = {"mean": self.seconds_total}
        return entry


@dataclass(frozen=True)
class Failure:
    """A run that an estimator did not survive."""

    run: int
    estimator: str
    error: str


@dataclass(frozen=True)
class Summary:
    """summary.json as an object."""

    scenario: str
    runs: int
    seed: int
    digest: str
    failures: tuple[Failure, ...]
    estimators: dict[str, EstimatorSummary]

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        return {
            "scenario": self.scenario,
            "runs": self.runs,
            "seed": self.seed,
            "digest": self.digest,
            "failures": [asdict(failure) for failure in self.failures],
            "estimators": {name: entry.to_json() for name, entry in self.estimators.items()},
        }


def summarise(runs: Mapping[str, Runs]) -> dict[str, EstimatorSummary]:
    """Summaries of estimators that ran on the same recordings."""
    return {name: _summarise(each, runs) for name, each in runs.items()}


class PerStep(NamedTuple):
    """A chi-square statistic of all runs together at every step (N+1,), and its band; NaN where undefined."""

    value: Float
    low: Float
    high: Float


def nees_per_step(runs: Runs) -> PerStep:
    """Mean pose NEES over runs: 3 when consistent."""
    nees = runs.series["nees_pose"]
    count = (~np.isnan(nees)).sum(axis=0)
    return _per_step(np.nansum(nees, axis=0), 3 * count, count)


def nis_per_step(runs: Runs) -> PerStep:
    """NIS over its degrees of freedom: 1 when the innovations are as large as the filter expects."""
    dof = np.nansum(runs.series["nis_dof"], axis=0).astype(np.int64)
    return _per_step(np.nansum(runs.series["nis"], axis=0), dof, dof)


def _per_step(total: Float, dof: Int, unit: Int) -> PerStep:
    """Sums with `dof` degrees of freedom (N+1,), and their band, divided by `unit`."""
    bands = {each: chi2_band(BAND_LEVEL, each) for each in np.unique(dof).tolist() if each}
    low, high = np.array([bands.get(each, (np.nan, np.nan)) for each in dof.tolist()]).reshape(-1, 2).T
    divisor = np.where(unit > 0, unit, np.nan)
    return PerStep(total / divisor, low / divisor, high / divisor)


def _summarise(runs: Runs, others: Mapping[str, Runs]) -> EstimatorSummary:
    figures, series = runs.figures, runs.series
    optimum = others.get(YARDSTICKS[runs.kind]) if runs.kind else None
    squares = series["error_x"] ** 2 + series["error_y"] ** 2
    average, low, high = nees_per_step(runs)
    defined = ~np.isnan(average)
    return EstimatorSummary(
        kind=runs.kind or None,
        runs=len(runs.run),
        ate_m=mean_interval(figures["ate_m"]),
        position_rmse_m=jackknife_interval(_mean_root, squares),
        heading_rmse_rad=jackknife_interval(_mean_root, series["error_heading"] ** 2),
        final_position_error_m=mean_interval(figures["final_position_error_m"]),
        nis_per_dof=ratio_interval(
            figures["nis_total"], np.where(figures["nis_dof_total"] > 0, figures["nis_dof_total"], np.nan)
        ),
        landmark_rmse_m=mean_interval(figures["landmark_rmse_m"]),
        landmark_nees_per_dof=mean_interval(figures["landmark_nees_per_dof"]),
        nees_pose_per_dof=_time_mean(series["nees_pose"] / 3),
        nees_position_per_dof=_time_mean(series["nees_position"] / 2),
        nees_heading=_time_mean(series["nees_heading"]),
        ratio_to_optimum=_ate_ratio(runs, optimum),
        ratio_to_causal=_ate_ratio(runs, others.get(CAUSAL)),
        ratio_to_hindsight=_ate_ratio(runs, others.get(HINDSIGHT)),
        position_sigma_m=mean_interval(reported_sigma(runs)),
        wrong_associations=mean_interval(figures["wrong_associations"]),
        landmarks_mapped=mean_interval(figures["landmarks_mapped"]),
        landmarks_missed=mean_interval(figures["landmarks_missed"]),
        landmarks_spurious=mean_interval(figures["landmarks_spurious"]),
        nees_share_inside_band=mean(((average >= low) & (average <= high))[defined].astype(np.float64)),
        sigma_ratio_to_optimum_final=_final_sigma_ratio(runs, optimum),
        rays=_rays(runs),
        seconds_total=mean(figures["seconds_total"]),
    )


def _rays(runs: Runs) -> RayFigures | None:
    columns = [runs.figures[f"rays_{name}"] for name in RayFigures._fields]
    rows = (RayFigures(*row) for row in np.array(columns).T.tolist())
    return mean_figures([row for row in rows if not np.isnan(row.members)])


def reported_sigma(runs: Runs) -> Float:
    """(R,) RMS over steps of the position sigma [m] that the estimator reports, NaN where it reports none."""
    variances = runs.series["sigma_x"] ** 2 + runs.series["sigma_y"] ** 2
    late = variances[:, FIRST_STEP:]
    return np.sqrt(late.mean(axis=1)) if late.size else np.full(len(variances), np.nan)


def _mean_root(sums: Float, count: int) -> Float:
    """Mean over steps of the root of the mean over runs."""
    return np.sqrt(np.maximum(sums, 0.0) / count).mean(axis=-1)


def _time_mean(series: Float) -> Interval | None:
    """Interval over runs of each run's mean from step FIRST_STEP on."""
    late = series[:, FIRST_STEP:]
    defined = ~np.isnan(late)
    count = defined.sum(axis=1)
    sums = np.where(defined, late, 0.0).sum(axis=1)
    return mean_interval(np.divide(sums, count, out=np.full(len(series), np.nan), where=count > 0))


def paired(runs: Runs, optimum: Runs) -> tuple[Int, Int]:
    """Rows of the runs that both have."""
    _, ours, theirs = np.intersect1d(runs.run, optimum.run, assume_unique=True, return_indices=True)
    return ours, theirs


def _ate_ratio(runs: Runs, optimum: Runs | None) -> Interval | None:
    if optimum is None:
        return None
    ours, theirs = paired(runs, optimum)
    return ratio_interval(runs.figures["ate_m"][ours], optimum.figures["ate_m"][theirs])


def _final_sigma_ratio(runs: Runs, optimum: Runs | None) -> tuple[float | None, ...] | None:
    if optimum is None:
        return None
    ours, theirs = paired(runs, optimum)
    if not len(ours):
        return None
    ratios = []
    for key in ("sigma_x", "sigma_y", "sigma_heading"):
        last, best = runs.series[key][ours, -1], optimum.series[key][theirs, -1]
        ratios.append(mean(np.divide(last, best, out=np.full(len(ours), np.nan), where=best > 0)))
    return tuple(ratios)


_COLUMNS = (
    ("ATE [m]", "ate_m", "{:.3f}"),
    ("x causal", "ratio_to_causal", "{:.3f}"),
    ("x hindsight", "ratio_to_hindsight", "{:.3f}"),
    ("heading [rad]", "heading_rmse_rad", "{:.4f}"),
    ("end [m]", "final_position_error_m", "{:.3f}"),
    ("NEES/3", "nees_pose_per_dof", "{:.2f}"),
    ("NIS/dof", "nis_per_dof", "{:.3f}"),
    ("map NEES/2", "landmark_nees_per_dof", "{:.2f}"),
    ("wrong", "wrong_associations", "{:.1f}"),
    ("mapped", "landmarks_mapped", "{:.1f}"),
)


def summary_table(summary: Summary) -> str:
    """Means with their 95 % intervals, the share of steps inside the band, sigma ratios, failures."""
    head = ["estimator", "runs", *(title for title, _, _ in _COLUMNS), f"in {BAND_LEVEL:.1%} band", "sigma / optimum"]
    rows = [head]
    for name, entry in summary.estimators.items():
        cells = [name, str(entry.runs), *(interval_cell(getattr(entry, key), form) for _, key, form in _COLUMNS)]
        share, ratios = entry.nees_share_inside_band, entry.sigma_ratio_to_optimum_final
        cells.append("-" if share is None else f"{share:.1%}")
        cells.append("-" if ratios is None else " ".join("-" if r is None else f"{r:.3f}" for r in ratios))
        rows.append(cells)
    rays = [
        f"{name}: a run's {describe(each.rays)}" for name, each in summary.estimators.items() if each.rays is not None
    ]
    return "\n".join([*aligned(rows, words=1), *rays, *failure_lines(summary)])


def failure_lines(summary: Summary) -> list[str]:
    """A line for each run that an estimator did not survive."""
    return [f"run {failure.run}: {failure.estimator} failed: {failure.error}" for failure in summary.failures]
