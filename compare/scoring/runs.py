"""Declaration of metrics, and stored runs of one estimator in a study: means, ratios and figures by step.

Decorated methods of `Measured` are metrics of a run, those of `Runs` metrics of a study: the name is the key, the
docstring the meaning. Their files, stores, tables and pages, and the manual (`docs/make_tables.py`) follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.registry import BOUND_OF, CAUSAL, OPTIMA, REGISTRY
from slamgauge.compare.scoring.consistency import chi2_band, is_inside
from slamgauge.compare.scoring.intervals import Interval, half_widths, jackknife_interval, mean, mean_interval
from slamgauge.compare.scoring.intervals import ratio_interval as ratio_of
from slamgauge.compare.scoring.optimum_notes import is_misfit_in_runs, share_of_doubt
from slamgauge.compare.scoring.table import Head, sized
from slamgauge.compare.scoring.verdicts import Evidence

# stored for every step: errors and sigmas [m, m, rad], NEES, and the NIS with its degrees of freedom
SERIES = (
    *("error_x", "error_y", "error_heading", "sigma_x", "sigma_y", "sigma_heading"),
    *("nees_pose", "nees_position", "nees_heading", "nis", "nis_dof"),
)
RAYS = ("members", "collapsed", "wrong", "off", "lost", "left")  # figures of `Measured.rays`
BAND_LEVEL = 0.999  # probability of the chi-square bands at every step
FIRST_STEP = 11  # first step of NEES means: before it the start still dominates

OverRuns = Callable[[Any, Mapping[str, Any]], Any]  # arguments: `Runs` of the estimator, and those of all by name
Stored = bool | Sequence[str]  # whether a figure is stored, or the keys of the parts of a figure that is a dictionary
Function = TypeVar("Function", bound=Callable[..., Any])


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

    key: str  # in metrics.json and summary.json
    help: str
    column: Column | None  # in tables
    measure: Callable[[Any], Any] | None = None  # method of `Measured`; None: not in metrics.json
    over_runs: OverRuns | None = None  # None: not in summary.json
    stored: tuple[str, ...] = ()  # names in the store of a study, one for each part of the figure


BY_KEY: dict[str, Metric] = {}  # all metrics, once `catalogue` is imported


def of_run(
    column: Column | None = None, over_runs: OverRuns | None = None, *, stored: Stored = False, averaged: bool = False
) -> Callable[[Function], Function]:
    """Declare a figure of runs: aggregated by `over_runs`, `stored` by studies, or stored and `averaged` by them."""

    def declare(measure: Function) -> Function:
        key = measure.__name__
        mean = (lambda runs, _: mean_interval(runs.figures[key])) if averaged else over_runs
        parts = () if isinstance(stored, bool) else stored
        names = tuple(f"{key}_{part}" for part in parts) or (key,) * (averaged or stored is True)
        return _declared(measure, column, measure=measure, over_runs=mean, stored=names)

    return declare


def of_study(column: Column | None = None) -> Callable[[Function], Function]:
    """Declare a figure of many runs."""
    return lambda aggregate: _declared(aggregate, column, over_runs=aggregate)


def _declared(function: Function, column: Column | None, **parts: Any) -> Function:
    key, meaning = function.__name__, " ".join((function.__doc__ or "").split()).removesuffix(".")
    head = None if column is None else replace(column, key=key, help=meaning)
    BY_KEY[key] = Metric(key, meaning, head, **parts)
    return function


class PerStep(NamedTuple):
    """A statistic of all runs at every step (N+1,) and its band; NaN where undefined."""

    value: Float
    low: Float
    high: Float


@dataclass(frozen=True)
class Runs:
    """Runs of one estimator without the failed ones; NaN where a figure is undefined."""

    run: Int  # (R,) numbers of the runs, increasing
    kind: str  # `filtered` or `smoothed`
    figures: dict[str, Float]  # (R,) by key (`catalogue.STORED`)
    series: dict[str, Float]  # (R, N+1) by name (`SERIES`)

    def squares(self, *series: str) -> Float:
        """Return the sums (R, N+1) of the squares of these series."""
        return np.sum([self.series[key] ** 2 for key in series], axis=0)

    def reported_sigma(self) -> Float:
        """Return the RMS over steps (R,) of the position sigma [m] that the estimator reports; NaN without one."""
        late = self.squares("sigma_x", "sigma_y")[:, FIRST_STEP:]
        return np.sqrt(late.mean(axis=1)) if late.size else np.full(len(late), np.nan)

    def nees_per_step(self) -> PerStep:
        """Return the mean pose NEES over runs, 3 if consistent, in a chi-square band."""
        count = (~np.isnan(self.series["nees_pose"])).sum(axis=0)
        return _in_band(self.series["nees_pose"], 3 * count, count)

    def nis_per_step(self) -> PerStep:
        """Return the NIS over its degrees of freedom, 1 if innovations are as expected, in a chi-square band."""
        dof = np.nansum(self.series["nis_dof"], axis=0).astype(np.int64)
        return _in_band(self.series["nis"], dof, dof)

    def rmse_per_step(self) -> PerStep:
        """Return the RMS position error [m] over runs, and the root of Student's 95 % interval of the mean square."""
        squares = self.squares("error_x", "error_y")
        middle, half = squares.mean(axis=0), half_widths(squares)
        return PerStep(np.sqrt(middle), np.sqrt(np.maximum(middle - half, 0.0)), np.sqrt(middle + half))

    def late_coverage(self, _: Others) -> Interval | None:
        """Return the share of the steps, from FIRST_STEP on, at which the 95 % ellipse contains the position."""
        return mean_interval(late_means(is_inside(self.series["nees_position"], 0.95)))

    def heading_rmse(self, _: Others) -> Interval | None:
        """Return the mean over steps of the RMS heading error over runs."""
        return jackknife_interval(_mean_root, self.squares("error_heading"))

    def total_nis(self, _: Others) -> Interval | None:
        """Return the NIS over its degrees of freedom."""
        dof = self.figures["nis_dof_total"]
        return ratio_of(self.figures["nis_total"], np.where(dof > 0, dof, np.nan))

    def over_optimum(self, others: Others, name: str | None = None) -> Interval | None:
        """Return mean ATE over that of an optimum on the same runs; by default the one of the same kind."""
        optimum = others.get(name or OPTIMA.get(self.kind, ""))
        if optimum is None:
            return None
        ours, theirs = paired(self, optimum)
        return ratio_of(self.figures["ate_m"][ours], optimum.figures["ate_m"][theirs])

    def mean_rays(self, _: Others) -> dict[str, float | None] | None:
        """Return the mean figures of the rays of a run; None without rays."""
        means = {name: mean(self.figures[f"rays_{name}"]) for name in RAYS}
        return None if means["members"] is None else means

    def verdict(self, others: Others) -> str | None:
        """Return the verdict on the runs."""
        return self.evidence(others).verdict() if self.kind else None

    @of_study()
    def faults(self, others: Others) -> tuple[str, ...]:
        """Faults in a few words, without sizes (`verdicts`)."""
        return self.evidence(others).faults() if self.kind else ()

    def evidence(self, others: Others) -> Evidence:
        """Return the figures on which the verdict is based; the ratio to an optimum in doubt is left out."""
        name, ratio, common = OPTIMA[self.kind], None, 0
        optimum = others.get(name, self)
        is_misfit = is_misfit_in_runs(mean_interval(optimum.figures["chi_square_per_dof"]))
        if optimum is not self and not is_misfit and not optimum.optimum_check_share(others):
            ratio, common = self.over_optimum(others), len(paired(self, optimum)[0])
        return Evidence(
            runs=int(np.sum(~np.isnan(late_means(self.series["nees_pose"])))),
            nees_per_dof=sized(self.nees_pose_per_dof(others)),
            coverage_95=sized(self.late_coverage(others)),
            nis_per_dof=sized(self.total_nis(others)),
            nis_dof=int(np.nansum(self.figures["nis_dof_total"])),
            ratio=ratio,
            ratio_runs=common,
            optimum=REGISTRY[name].title,
            wrong_associations=mean(self.figures["wrong_associations"]),
        )

    @of_study(Column("RMSE [m]", study=2, sweep=2, of_bounds=True))
    def position_rmse_m(self, _: Others) -> Interval | None:
        """Mean over steps of the RMS position error over runs (as in the literature)."""
        return jackknife_interval(_mean_root, self.squares("error_x", "error_y"))

    @of_study(Column("NEES/3", form="{:.2f}", study=5, sweep=5))
    def nees_pose_per_dof(self, _: Others) -> Interval | None:
        """Mean over runs and steps from the 11th on of the pose NEES over 3."""
        return mean_interval(late_means(self.series["nees_pose"] / 3))

    @of_study(Column("x causal", study=3, sweep=3, relative=True))
    def ratio_to_causal(self, others: Others) -> Interval | None:
        """ATE over that of the causal optimum."""
        return self.over_optimum(others, CAUSAL)

    @of_study(Column("x bound", study=4, sweep=4, of_bounds=True))
    def ratio_to_bound(self, others: Others) -> Interval | None:
        """`position_rmse_m` over that of the Cramer-Rao bound of the same kind, over the same runs."""
        bound = others.get(BOUND_OF.get(self.kind, ""))
        if bound is None:
            return None
        ours, theirs = paired(self, bound)
        squares = self.squares("error_x", "error_y")[ours], bound.squares("error_x", "error_y")[theirs]

        def ratio(sums: Float, count: int) -> Float:
            above, below = np.split(sums, 2, axis=-1)
            return _mean_root(above, count) / _mean_root(below, count)

        return jackknife_interval(ratio, np.concatenate(squares, axis=1))

    @of_study(Column("sigma [m]", "reported position sigma [m]", sweep=6))
    def position_sigma_m(self, _: Others) -> Interval | None:
        """RMS position sigma that the estimator reports."""
        return mean_interval(self.reported_sigma())

    @of_study()
    def optimum_check_share(self, _: Others) -> float | None:
        """Share of the runs in which the optimum's check is above 0.05 sigma."""
        return share_of_doubt(self.figures["optimum_check_sigma"])


Others = Mapping[str, Runs]  # runs of all estimators by name


def paired(runs: Runs, optimum: Runs) -> tuple[Int, Int]:
    """Return the rows of the common runs in `runs` and in `optimum`."""
    _, ours, theirs = np.intersect1d(runs.run, optimum.run, assume_unique=True, return_indices=True)
    return ours, theirs


def rays_text(rays: Mapping[str, Any]) -> str:
    """Return the figures of the rays of one run, or their means over runs, in a sentence."""
    judged = "" if rays["wrong"] is None else f" ({rays['wrong']:.3g} wrongly, {rays['off']:.3g} end off by 3 sigma)"
    rest = f"{rays['lost']:.3g} were lost, {rays['left']:.3g} are left; {rays['members']:.3g} members in the state"
    return f"{rays['collapsed']:.4g} rays became points{judged}, {rest}"


def late_means(series: Float) -> Float:
    """Return the mean of each run (R,) from step FIRST_STEP on of a series (R, N+1) with gaps; NaN without values."""
    late = series[:, FIRST_STEP:]
    count = (~np.isnan(late)).sum(axis=1)
    return np.divide(np.nansum(late, axis=1), count, out=np.full(len(series), np.nan), where=count > 0)


def _mean_root(sums: Float, count: int) -> Float:
    """Return the mean over steps of the root of the mean over runs."""
    return np.sqrt(np.maximum(sums, 0.0) / count).mean(axis=-1)


def _in_band(series: Float, dof: Int, unit: Int) -> PerStep:
    """Return sums over runs with `dof` degrees of freedom (N+1,) and their band, divided by `unit`."""
    bands = {each: chi2_band(BAND_LEVEL, each) if each else (np.nan, np.nan) for each in np.unique(dof).tolist()}
    low, high = np.array([bands[each] for each in dof.tolist()]).reshape(-1, 2).T
    divisor = np.where(unit > 0, unit, np.nan)
    return PerStep(np.nansum(series, axis=0) / divisor, low / divisor, high / divisor)
