"""Comparison of a study with an earlier one on the same measurements: a gate for continuous integration.

The ratio of the mean ATE (and NEES) to that of the baseline has an interval over the common runs, by the delta method
on the paired figures. An estimator is worse if the whole interval is above 1 + tolerance. If every true ratio is at
most 1 + tolerance, the gate fails with a probability of at most `FALSE_ALARMS`, which is divided equally among the
comparisons (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.compare.estimators.registry import BOUNDS, is_optimum
from slamgauge.compare.scoring.intervals import needed_runs
from slamgauge.compare.studies.paired_comparisons import FIGURES
from slamgauge.compare.studies.stored_study import read_summary
from slamgauge.compare.studies.summary import Summary
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.version import __version__

FALSE_ALARMS = 0.05  # largest probability that a gate fails although no true ratio exceeds 1 + tolerance
AGAIN = "make the baseline again with this version and this scenario"


class Gate(NamedTuple):
    """A baseline, estimator and figure of each comparison with it, and the accepted relative increase."""

    baseline: Summary
    compared: list[tuple[str, str]]
    tolerance: float

    def judge(self, study: Summary) -> tuple[list[str], list[str]]:
        """Return a line on each comparison with a study, and those lines on what is worse."""
        lines: dict[str, bool] = {}  # whether something is worse, by line
        level = 1.0 - 2.0 * FALSE_ALARMS / len(self.compared)  # only the lower end decides
        worse, limit = f"worse by more than {100 * self.tolerance:g} %", 1.0 + self.tolerance
        for name, figure in self.compared:
            ours, theirs = study.per_run[name], self.baseline.per_run[name]
            failed = sorted({run for run in theirs.run if run < study.runs} - {*ours.run})
            if failed:
                runs = counted(len(failed), "run")
                lines[f"{name}: fails in {runs} of the baseline, first in run {failed[0]}"] = True
            common, found = ours.in_runs_of(theirs, figure), ours.against(theirs, level).get(figure)
            if found is None or found.ratio is None:
                if common.size and np.isnan(common).all():
                    lines[f"{name}: has no {FIGURES[figure]}, as the baseline has"] = True
                continue
            ratio = found.ratio
            low, high = ("?" if end is None else f"{end:.3f}" for end in (ratio.low, ratio.high))
            verdict = worse
            if not ratio.is_above(limit):
                plain = ours.against(theirs)[figure].ratio  # its level does not depend on the number of comparisons
                needed = needed_runs(plain or ratio, found.runs)
                verdict = f"not {worse}" if ratio.is_below(limit) else f"not significantly {worse}{needed}"
            text = f"{ratio.mean:.3f} ({low} to {high}) times the baseline's on {counted(found.runs, 'run')}: {verdict}"
            lines[f"{name}: {FIGURES[figure]} is {text}"] = ratio.is_above(limit)
        return [*lines], [line for line, is_worse in lines.items() if is_worse]


def open_gate(baseline: Summary, names: Iterable[str], digest: str, tolerance: float, where: str) -> Gate:
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


def as_study(study: Summary | str | Path) -> Summary:
    """Return a study, or the study with the summary.json at a path.

    Raises:
        UserError: the file is not what `study` writes, or of another version.
    """
    if isinstance(study, Summary):
        return study
    content, summary = read_summary(Path(study))
    if content.get("version") != __version__:
        raise UserError(f"{study}: of slamgauge {content.get('version')}, this is {__version__}; {AGAIN}")
    return summary


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
    ours = as_study(current)
    name = str(baseline) if isinstance(baseline, (str, Path)) else "baseline"
    _, worse = open_gate(as_study(baseline), ours.per_run, ours.digest, tolerance, name).judge(ours)
    if worse:
        lines = [*worse, false_alarms(tolerance)]
        raise AssertionError("\n".join(["worse than the baseline:", *(f"  {line}" for line in lines)]))
