"""Comparison of a study with an earlier one on the same measurements: a gate for continuous integration.

The ratio of the mean ATE (and NEES) to that of the baseline has an interval over the common runs, by the delta method
on the paired figures. An estimator is worse if the whole interval is above 1 + tolerance. If every true ratio is at
most 1 + tolerance, any of the comparisons fails with a probability of at most `FALSE_ALARMS`, which is divided equally
among the comparisons (Bonferroni) and, if runs are added, among the looks (`scoring.sequential`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import BOUNDS, OPTIMA
from slamgauge.compare.scoring.intervals import Interval, ratio_interval
from slamgauge.compare.scoring.sequential import Look, plan_looks
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.studies.summary import RunFigures, Summary
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.version import __version__

FALSE_ALARMS = 0.05  # largest probability that a gate fails although no true ratio exceeds 1 + tolerance
POWER = 0.9  # probability of finding a ratio of 1 + 2 tolerance, for the number of runs that it needs
FIGURES = {"ate_m": "ATE", "nees_pose_per_dof": "NEES"}
AGAIN = "make the baseline again with this version and this scenario"


class Baseline(NamedTuple):
    """An earlier study: its digest and the figures of each run by estimator, without optima and bounds."""

    digest: str
    per_run: dict[str, RunFigures]


class Change(NamedTuple):
    """Ratio of a mean figure to that of the baseline on the common runs."""

    name: str
    figure: str
    runs: int
    ratio: Interval
    tolerance: float
    level: float

    @property
    def is_worse(self) -> bool:
        """Whether the whole interval is above 1 + tolerance."""
        return self.ratio.low is not None and self.ratio.low > 1.0 + self.tolerance

    @property
    def is_settled(self) -> bool:
        """Whether the interval does not contain 1 + tolerance."""
        return self.is_worse or (self.ratio.high is not None and self.ratio.high < 1.0 + self.tolerance)

    @property
    def needed_runs(self) -> int | None:
        """Runs in which a ratio of 1 + 2 tolerance is found with probability `POWER`, in normal approximation."""
        if self.ratio.high is None:
            return None
        normal = NormalDist()
        bound = normal.inv_cdf((1.0 + self.level) / 2.0)
        sought = 1.0 + 2.0 * self.tolerance
        spread = (self.ratio.high / self.ratio.mean - 1.0) * sought / bound * math.sqrt(self.runs)
        return max(math.ceil(((bound + normal.inv_cdf(POWER)) * spread / self.tolerance) ** 2), 2)

    def line(self) -> str:
        """Return the ratio, its interval and the result in one line."""
        low, high = ("?" if end is None else f"{end:.3f}" for end in self.ratio[1:])
        text = f"{self.name}: {FIGURES[self.figure]} is {self.ratio.mean:.3f} ({low} to {high}) times the baseline's "
        text += f"on {counted(self.runs, 'run')}: "
        limit = f"worse by more than {100 * self.tolerance:g} %"
        if self.is_worse:
            return text + limit
        text += f"not {limit}" if self.is_settled else f"not significantly {limit}"
        needed = self.needed_runs
        return text if needed is None else f"{text}; {1 + 2 * self.tolerance:g} would be found in {needed} runs"


class Result(NamedTuple):
    """Result of a gate: changes, and lines on runs or figures that the baseline has and the study lost."""

    changes: list[Change]
    lost: list[str]

    @property
    def worse(self) -> list[str]:
        """Lines on everything that is worse."""
        return [*self.lost, *(each.line() for each in self.changes if each.is_worse)]

    @property
    def is_settled(self) -> bool:
        """Whether more runs are unnecessary."""
        return bool(self.worse) or all(each.is_settled for each in self.changes)


def assert_not_worse(current: Summary | str | Path, baseline: Summary | str | Path, tolerance: float = 0.05) -> None:
    """Assert that no estimator of a study is significantly worse than in an earlier study of the same runs.

    The mean ATE and the mean pose NEES of each estimator of both studies, except optima and bounds, are compared on
    the common runs. A figure is worse if the whole interval of its ratio is above 1 + tolerance. The assertion fails
    with a probability of at most 5 % if no true ratio exceeds 1 + tolerance. It also fails if an estimator fails in a
    run that it completed in the baseline.

    Args:
        current: a study, as `run_study` returns it, or the path of its summary.json.
        baseline: the earlier study, with the same scenario, root seed and version of slamgauge.
        tolerance: relative increase that is accepted.

    Raises:
        AssertionError: with figure and interval of each estimator that is worse.
        UserError: the studies have other measurements, another version, or no common estimator.
    """
    __tracebackhide__ = True  # pytest then shows the caller's line
    ours, theirs = _read(current), _read(baseline)
    name = str(baseline) if isinstance(baseline, (str, Path)) else "baseline"
    compared = comparisons(ours.per_run, theirs, ours.digest, name)
    runs = 1 + max(run for each in ours.per_run.values() for run in each.run)
    found = compare(ours.per_run, theirs, compared, require_tolerance(tolerance), looks(compared, runs, runs)[0])
    if found.worse:
        lines = [*found.worse, false_alarms(tolerance)]
        raise AssertionError("\n".join(["worse than the baseline:", *(f"  {line}" for line in lines)]))


def load_baseline(path: Path) -> Baseline:
    """Read the summary.json of a study.

    Raises:
        UserError: it is not what `study` writes, or of another version.
    """
    content = read_json(path, "study")
    try:
        if content["version"] != __version__:
            raise UserError(f"{path}: of slamgauge {content['version']}, this is {__version__}; {AGAIN}")
        per_run = {name: RunFigures(**each) for name, each in content["per_run"].items()}
        return Baseline(content["digest"], per_run)
    except (TypeError, KeyError, AttributeError):
        raise UserError(f"{path}: not what `slamgauge study` writes; {AGAIN}") from None


def _read(study: Summary | str | Path) -> Baseline:
    return Baseline(study.digest, dict(study.per_run)) if isinstance(study, Summary) else load_baseline(Path(study))


def false_alarms(tolerance: float) -> str:
    """Return a line with the false-alarm rate of a gate."""
    return f"false alarms: if no true ratio exceeds {1.0 + tolerance:g}, at most {FALSE_ALARMS:.0%} of the gates fail"


def require_tolerance(tolerance: float) -> float:
    """Refuse a tolerance that is not a positive share."""
    if not 0.0 < tolerance < 10.0:
        raise UserError(f"tolerance = {tolerance}: not a share; give for example 0.05 for 5 %")
    return tolerance


def comparisons(names: Iterable[str], baseline: Baseline, digest: str, where: str) -> list[tuple[str, str]]:
    """Return estimator and figure of each comparison with a baseline.

    Raises:
        UserError: the baseline has other measurements, or none of these estimators.
    """
    if baseline.digest != digest:
        raise UserError(f"{where}: has other measurements (another scenario, seed or --set); {AGAIN}")
    reference = {*OPTIMA.values(), *BOUNDS}
    found = [
        (name, figure)
        for name in names
        if name in baseline.per_run and name not in reference
        for figure in FIGURES
        if any(value is not None for value in getattr(baseline.per_run[name], figure))
    ]
    if not found:
        raise UserError(f"{where}: has figures of none of these estimators; it has {', '.join(baseline.per_run)}")
    return found


def looks(compared: Sequence[tuple[str, str]], first: int, most: int) -> tuple[Look, ...]:
    """Return the looks of a gate from `first` to `most` runs; a figure exceeds its one-sided bound at any of them."""
    return plan_looks(first, max(first, most), 2.0 * FALSE_ALARMS / len(compared))


def compare(
    current: Mapping[str, RunFigures],
    baseline: Baseline,
    compared: Sequence[tuple[str, str]],
    tolerance: float,
    look: Look,
) -> Result:
    """Compare the first `look.runs` runs of a study with those of a baseline."""
    found = Result([], [])
    for name in dict.fromkeys(name for name, _ in compared):
        failed = sorted({run for run in baseline.per_run[name].run if run < look.runs} - {*current[name].run})
        if failed:
            found.lost.append(
                f"{name}: fails in {counted(len(failed), 'run')} of the baseline, first in run {failed[0]}"
            )
    for name, figure in compared:
        ours, theirs = _common(current[name], baseline.per_run[name], figure)
        ratio = ratio_interval(ours, theirs, look.level)
        if ratio is not None:
            runs = int(np.sum(~np.isnan(ours) & ~np.isnan(theirs)))
            found.changes.append(Change(name, figure, runs, ratio, tolerance, look.level))
        elif len(ours) and np.isnan(ours).all():
            found.lost.append(f"{name}: has no {FIGURES[figure]}, as the baseline has")
    return found


def _common(current: RunFigures, baseline: RunFigures, figure: str) -> tuple[Float, Float]:
    """Return a figure (C,) of the common runs in both studies, NaN where undefined."""
    _, ours, theirs = np.intersect1d(current.run, baseline.run, assume_unique=True, return_indices=True)
    values = (np.array(getattr(each, figure), dtype=np.float64) for each in (current, baseline))
    return next(values)[ours], next(values)[theirs]


def run_gated(
    run: Callable[[int], Summary], baseline: Baseline, compared: Sequence[tuple[str, str]], tolerance: float, first: int
) -> tuple[Summary, Result]:
    """Run a study, from `first` runs to those of the baseline, until each comparison is settled.

    Args:
        run: returns the study with a number of runs.
        baseline: earlier study.
        compared: estimator and figure of each comparison.
        tolerance: relative increase that is accepted.
        first: runs before the first look.
    """
    most = 1 + max(run for name, _ in compared for run in baseline.per_run[name].run)
    planned = looks(compared, first, most)

    def evaluated(look: Look) -> tuple[Summary, Result]:
        summary = run(look.runs)
        return summary, compare(summary.per_run, baseline, compared, tolerance, look)

    found = evaluated(planned[0])
    for look in planned[1:]:
        if found[1].is_settled:
            break
        found = evaluated(look)
    return found
