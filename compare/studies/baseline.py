"""Comparison of a study with an earlier one on the same measurements: a gate for continuous integration.

The ratio of the mean ATE (and NEES) to that of the baseline has an interval over the common runs, by the delta method
on the paired figures. An estimator is worse if the whole interval is above 1 + tolerance. If every true ratio is at
most 1 + tolerance, the gate fails with a probability of at most `FALSE_ALARMS`, which is divided equally among the
comparisons (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from slamgauge.compare.estimators.registry import BOUNDS, is_optimum
from slamgauge.compare.scoring.intervals import Interval, is_above, is_below
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.studies.paired_comparisons import FIGURES, RunFigures
from slamgauge.compare.studies.summary import Summary
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.version import __version__

FALSE_ALARMS = 0.05  # largest probability that a gate fails although no true ratio exceeds 1 + tolerance
POWER = 0.9  # probability of finding a ratio of 1 + 2 tolerance, for the number of runs that it needs
AGAIN = "make the baseline again with this version and this scenario"


@dataclass(frozen=True)
class StudyFigures:
    """Digest of a study's measurements, number of its runs, figures of each run by estimator, and its version."""

    digest: str
    runs: int
    per_run: Mapping[str, RunFigures]
    version: str


class Gate(NamedTuple):
    """A baseline, estimator and figure of each comparison with it, and the accepted relative increase."""

    baseline: StudyFigures
    compared: list[tuple[str, str]]
    tolerance: float

    @property
    def level(self) -> float:
        """Probability of each interval; only its lower end decides."""
        return 1.0 - 2.0 * FALSE_ALARMS / len(self.compared)

    def judge(self, study: StudyFigures) -> tuple[list[str], list[str]]:
        """Return a line on each comparison with a study, and those lines on what is worse."""
        lines = [*filter(None, (self._lost(name, study) for name in dict.fromkeys(name for name, _ in self.compared)))]
        worse = [*lines]
        for name, figure in self.compared:
            ours, theirs = study.per_run[name], self.baseline.per_run[name]
            found = ours.against(theirs, self.level).get(figure)
            if found is not None and found.ratio is not None:
                lines.append(f"{name}: {FIGURES[figure]} is {self._sentence(found.ratio, found.runs)}")
                worse += lines[-1:] if is_above(found.ratio, 1.0 + self.tolerance) else []
            elif (common := ours.in_runs_of(theirs, figure)).size and np.isnan(common).all():
                lines.append(f"{name}: has no {FIGURES[figure]}, as the baseline has")
                worse.append(lines[-1])
        return lines, worse

    def _lost(self, name: str, study: StudyFigures) -> str:
        """Return a line if an estimator fails in runs that it completed in the baseline, else nothing."""
        done = {run for run in self.baseline.per_run[name].run if run < study.runs}
        failed = sorted(done - {*study.per_run[name].run})
        runs = counted(len(failed), "run")
        return f"{name}: fails in {runs} of the baseline, first in run {failed[0]}" if failed else ""

    def _sentence(self, ratio: Interval, runs: int) -> str:
        """Return a ratio, its interval over the common runs, and the result."""
        low, high = ("?" if end is None else f"{end:.3f}" for end in (ratio.low, ratio.high))
        text = f"{ratio.mean:.3f} ({low} to {high}) times the baseline's on {counted(runs, 'run')}: "
        limit = f"worse by more than {100 * self.tolerance:g} %"
        if is_above(ratio, 1.0 + self.tolerance):
            return text + limit
        if ratio.high is None:
            return f"{text}not significantly {limit}"
        text += f"not {limit}" if is_below(ratio, 1.0 + self.tolerance) else f"not significantly {limit}"
        normal, sought = NormalDist(), 1.0 + 2.0 * self.tolerance
        bound = normal.inv_cdf((1.0 + self.level) / 2.0)
        spread = (ratio.high / ratio.mean - 1.0) * sought / bound * math.sqrt(runs)
        needed = math.ceil(((bound + normal.inv_cdf(POWER)) * spread / self.tolerance) ** 2)
        return f"{text}; {sought:g} would be found in {max(needed, 2)} runs"


def open_gate(baseline: StudyFigures, names: Iterable[str], digest: str, tolerance: float, where: str) -> Gate:
    """Return the gate of a study with that digest and these estimators; `where` is the path of the baseline.

    Raises:
        UserError: the tolerance is not a positive share, or the baseline has other measurements or estimators.
    """
    if not 0.0 < tolerance < 10.0:
        raise UserError(f"tolerance = {tolerance}: not a share; give for example 0.05 for 5 %")
    if baseline.digest != digest:
        raise UserError(f"{where}: has other measurements (another scenario, seed or --set); {AGAIN}")
    compared = [
        (name, figure)
        for name in names
        if name in baseline.per_run and not is_optimum(name) and name not in BOUNDS
        for figure in FIGURES
        if any(value is not None for value in getattr(baseline.per_run[name], figure))
    ]
    if not compared:
        raise UserError(f"{where}: has figures of none of these estimators; it has {', '.join(baseline.per_run)}")
    return Gate(baseline, compared, tolerance)


def figures_of(study: Summary | str | Path) -> StudyFigures:
    """Return the figures of a study, or of the study with the summary.json at a path.

    Raises:
        UserError: the file is not what `study` writes, or of another version.
    """
    if isinstance(study, Summary):
        return StudyFigures(study.digest, study.runs, study.per_run, __version__)
    content = read_json(Path(study), "study")
    try:
        if content["version"] != __version__:
            raise UserError(f"{study}: of slamgauge {content['version']}, this is {__version__}; {AGAIN}")
        return TypeAdapter(StudyFigures).validate_python(content)
    except (TypeError, KeyError, ValidationError):
        raise UserError(f"{study}: not what `slamgauge study` writes; {AGAIN}") from None


def false_alarms(tolerance: float) -> str:
    """Return a line with the false-alarm rate of a gate."""
    return f"false alarms: if no true ratio exceeds {1.0 + tolerance:g}, at most {FALSE_ALARMS:.0%} of the gates fail"


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
    ours = figures_of(current)
    name = str(baseline) if isinstance(baseline, (str, Path)) else "baseline"
    _, worse = open_gate(figures_of(baseline), ours.per_run, ours.digest, tolerance, name).judge(ours)
    if worse:
        lines = [*worse, false_alarms(tolerance)]
        raise AssertionError("\n".join(["worse than the baseline:", *(f"  {line}" for line in lines)]))
