"""How figures of single runs are summed up over runs: means with intervals, paired ratios, consistency per step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.registry import BOUND_OF, OPTIMA
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.coverage import is_inside
from slamgauge.compare.scoring.intervals import Interval, jackknife_interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_figures import share_of_doubt
from slamgauge.compare.scoring.ray_figures import RayFigures, mean_figures
from slamgauge.compare.scoring.runs import Runs, paired

BAND_LEVEL = 0.999  # of the chi-square band whose share of steps is given
FIRST_STEP = 11  # NEES means leave the first steps out, where the start still shows

OverRuns = Callable[[Runs, Mapping[str, Runs]], Any]  # the estimator's runs, and those of all by name


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


def rmse_per_step(runs: Runs) -> Float:
    """RMS position error [m] over runs at every step (N+1,)."""
    return np.sqrt((runs.series["error_x"] ** 2 + runs.series["error_y"] ** 2).mean(axis=0))


def _per_step(total: Float, dof: Int, unit: Int) -> PerStep:
    """Sums with `dof` degrees of freedom (N+1,), and their band, divided by `unit`."""
    bands = {each: chi2_band(BAND_LEVEL, each) for each in np.unique(dof).tolist() if each}
    low, high = np.array([bands.get(each, (np.nan, np.nan)) for each in dof.tolist()]).reshape(-1, 2).T
    divisor = np.where(unit > 0, unit, np.nan)
    return PerStep(total / divisor, low / divisor, high / divisor)


def reported_sigma(runs: Runs) -> Float:
    """(R,) RMS over steps of the position sigma [m] that the estimator reports, NaN where it reports none."""
    variances = runs.series["sigma_x"] ** 2 + runs.series["sigma_y"] ** 2
    late = variances[:, FIRST_STEP:]
    return np.sqrt(late.mean(axis=1)) if late.size else np.full(len(variances), np.nan)


def late_means(series: Float) -> Float:
    """(R,) means from step FIRST_STEP on of a series (R, N+1) that may have gaps; NaN where nothing is defined."""
    late = series[:, FIRST_STEP:]
    defined = ~np.isnan(late)
    count = defined.sum(axis=1)
    sums = np.where(defined, late, 0.0).sum(axis=1)
    return np.divide(sums, count, out=np.full(len(series), np.nan), where=count > 0)


# --- what the catalogue names --------------------------------------------------------------------


def mean_of(key: str) -> OverRuns:
    """The mean over runs of a figure that is stored."""
    return lambda runs, _: mean_interval(runs.figures[key])


def plain_mean_of(key: str) -> OverRuns:
    """The same without an interval."""
    return lambda runs, _: mean(runs.figures[key])


def mean_root_of(*series: str) -> OverRuns:
    """The mean over steps of the RMS over runs, of an error with these components."""

    def sum_up(runs: Runs, _: Mapping[str, Runs]) -> Interval | None:
        squares = sum((runs.series[key] ** 2 for key in series[1:]), runs.series[series[0]] ** 2)
        return jackknife_interval(_mean_root, squares)

    return sum_up


def late_mean_of(series: str, dof: int) -> OverRuns:
    """The mean over runs of each run's mean from step FIRST_STEP on, of a NEES over its degrees of freedom."""
    return lambda runs, _: mean_interval(late_means(runs.series[series] / dof))


def late_coverage(level: float) -> OverRuns:
    """The mean over runs of the share of the steps, from FIRST_STEP on, whose ellipse of `level` holds the position."""
    return lambda runs, _: mean_interval(late_means(is_inside(runs.series["nees_position"], level)))


def over_optimum(name: str | None = None) -> OverRuns:
    """Mean ATE over that of an optimum, paired run by run; of the same kind's unless it is named."""

    def sum_up(runs: Runs, others: Mapping[str, Runs]) -> Interval | None:
        optimum = _optimum(runs, others) if name is None else others.get(name)
        if optimum is None:
            return None
        ours, theirs = paired(runs, optimum)
        return ratio_interval(runs.figures["ate_m"][ours], optimum.figures["ate_m"][theirs])

    return sum_up


def over_bound(runs: Runs, others: Mapping[str, Runs]) -> Interval | None:
    """The mean over steps of the RMS position error over runs, over that of the bound of the same kind."""
    bound = others.get(BOUND_OF.get(runs.kind, ""))
    if bound is None:
        return None
    ours, theirs = paired(runs, bound)
    squares = [
        each.series["error_x"][at] ** 2 + each.series["error_y"][at] ** 2
        for each, at in ((runs, ours), (bound, theirs))
    ]

    def ratio(sums: Float, count: int) -> Float:
        above, below = np.split(sums, 2, axis=-1)
        return _mean_root(above, count) / _mean_root(below, count)

    return jackknife_interval(ratio, np.concatenate(squares, axis=1))


def excess_over(key: str, name: str) -> OverRuns:
    """The mean of a stored figure less that of another estimator, paired run by run."""

    def sum_up(runs: Runs, others: Mapping[str, Runs]) -> Interval | None:
        if name not in others:
            return None
        ours, theirs = paired(runs, others[name])
        return mean_interval(runs.figures[key][ours] - others[name].figures[key][theirs])

    return sum_up


def total_nis(runs: Runs, _: Mapping[str, Runs]) -> Interval | None:
    """NIS over its degrees of freedom."""
    dof = runs.figures["nis_dof_total"]
    return ratio_interval(runs.figures["nis_total"], np.where(dof > 0, dof, np.nan))


def position_sigma(runs: Runs, _: Mapping[str, Runs]) -> Interval | None:
    """The mean over runs of the reported sigma."""
    return mean_interval(reported_sigma(runs))


def share_inside_band(runs: Runs, _: Mapping[str, Runs]) -> float | None:
    """Share of steps whose mean pose NEES over runs lies in its chi-square band."""
    average, low, high = nees_per_step(runs)
    defined = ~np.isnan(average)
    return mean(((average >= low) & (average <= high))[defined].astype(np.float64))


def final_sigma_ratio(runs: Runs, others: Mapping[str, Runs]) -> tuple[float | None, ...] | None:
    """Mean over runs of the last sigma over the optimum's: x, y, heading."""
    optimum = _optimum(runs, others)
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


def share_in_doubt(runs: Runs, _: Mapping[str, Runs]) -> float | None:
    """Share of the runs with a check in which the optimum is farther from hindsight's than is good."""
    return share_of_doubt(runs.figures["optimum_check_sigma"])


def mean_rays(runs: Runs, _: Mapping[str, Runs]) -> RayFigures | None:
    """What became of the rays, in the mean over runs."""
    columns = [runs.figures[f"rays_{name}"] for name in RayFigures._fields]
    rows = (RayFigures(*row) for row in np.array(columns).T.tolist())
    return mean_figures([row for row in rows if not np.isnan(row.members)])


def _optimum(runs: Runs, others: Mapping[str, Runs]) -> Runs | None:
    """The runs of the optimum of the same kind, if it has any."""
    return others.get(OPTIMA[runs.kind]) if runs.kind else None


def _mean_root(sums: Float, count: int) -> Float:
    """Mean over steps of the root of the mean over runs."""
    return np.sqrt(np.maximum(sums, 0.0) / count).mean(axis=-1)
