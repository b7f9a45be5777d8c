"""Paired comparisons of the estimators of a study: ratios and differences of mean figures on the same runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import DEAD_RECKONING, is_optimum
from slamgauge.compare.estimators.requests import Asked, BuiltIn
from slamgauge.compare.scoring.intervals import LEVEL, Interval, Paired, compare_paired, needed_runs, number
from slamgauge.compare.scoring.runs import Runs, late_means
from slamgauge.compare.scoring.table import NO_FIGURE, RUNS, Cell, Head, Table, cell, figure
from slamgauge.display import counted

SMALLEST_P = 1e-6  # smaller ones are printed as `<1e-06`
FIGURES = {"ate_m": "ATE", "nees_pose_per_dof": "NEES"}  # titles of the compared figures

Against = Mapping[str, Mapping[str, Mapping[str, Paired]]]  # keys: reference estimator, estimator, figure


@dataclass(frozen=True)
class RunFigures:
    """Figures of one estimator in each run without failure, None where undefined, for comparisons."""

    run: list[int]  # numbers of the runs, increasing
    ate_m: list[float | None]
    nees_pose_per_dof: list[float | None]  # mean pose NEES over 3 from the 11th step on

    def in_runs_of(self, other: RunFigures, figure: str) -> Float:
        """Return a figure (C,) in the runs that another estimator has, too; NaN where undefined."""
        rows = np.isin(self.run, other.run)
        return np.array(getattr(self, figure), dtype=np.float64)[rows]  # None becomes NaN

    def against(self, other: RunFigures, level: float = LEVEL) -> dict[str, Paired]:
        """Compare each figure with that of another estimator on the common runs; left out if no run has both."""
        pairs = {key: (self.in_runs_of(other, key), other.in_runs_of(self, key)) for key in FIGURES}
        found = {key: compare_paired(*pair, level) for key, pair in pairs.items()}
        return {key: each for key, each in found.items() if each is not None}


def run_figures(runs: Runs) -> RunFigures:
    """Return the figures of each run of an estimator."""
    nees = late_means(runs.series["nees_pose"]) / 3
    return RunFigures(
        run=runs.run.tolist(),
        ate_m=[number(each) for each in runs.figures["ate_m"]],
        nees_pose_per_dof=[number(each) for each in nees],
    )


def compare_user_code(
    asked: Sequence[Asked], loaded: Mapping[str, Runs], figures: Mapping[str, RunFigures]
) -> tuple[str, ...]:
    """Return a sentence with the ratio of ATEs of each user estimator and each built-in filter of the same kind."""
    rivals = [each for each in asked if isinstance(each, BuiltIn) and not each.is_told and each.name != DEAD_RECKONING]
    sentences: list[str] = []
    for mine in (each.label for each in asked if not isinstance(each, BuiltIn)):
        for other in (each.label for each in rivals if loaded[each.label].kind == loaded[mine].kind):
            found = figures[mine].against(figures[other]).get("ate_m")
            if found is None or found.ratio is None:
                continue
            text = f"the ATE of {mine} is {cell(found.ratio, '{:.3f}')} times that of {other} on the same "
            text += counted(found.runs, "run")
            if found.runs < 2:
                text += "; an interval needs 2 runs"
            elif _excludes_1(found.ratio):
                text += " (95 % interval): the difference is significant"
            else:
                text += f" (95 % interval): the difference is not significant{needed_runs(found.ratio, found.runs)}"
            sentences.append(text)
    return tuple(sentences)


def _excludes_1(ratio: Interval) -> bool:
    """Return whether the interval of a ratio excludes 1 to the printed digits."""
    low, high = ratio.low, ratio.high
    return low is not None and high is not None and (round(low, 3) > 1 or round(high, 3) < 1)


def against_tables(against: Against) -> list[Table]:
    """Return a table for each reference estimator."""
    tables: list[Table] = []
    for name, others in against.items():
        heads = [
            Head(f"against {name}", help="name of the estimator", words=True),
            RUNS,
            Head("x ATE", help=f"mean ATE divided by that of {name}"),
            Head("ATE less [m]", help=f"mean difference of the ATE to that of {name}, run by run"),
            Head("p", help="p-value of the paired test of equal means"),
            Head("x NEES", help=f"mean NEES divided by that of {name}"),
            Head("NEES/3 less", help=f"mean difference of the NEES over 3 to that of {name}, run by run"),
            Head("p"),
        ]
        rows: list[list[Cell | str]] = []
        for label, figures in others.items():
            ate, nees = figures.get("ate_m"), figures.get("nees_pose_per_dof")
            runs = str(ate.runs) if ate else "0"
            rows.append([label, runs, *_cells(ate, "{:+.3f}"), *_cells(nees, "{:+.2f}")])
        tables.append(Table.of(heads, rows, f"Paired comparison with {name}", f"against-{len(tables)}"))
    return tables


def against_parts(against: Against) -> list[Table | str]:
    """Return the tables, each after an empty line, and below each the runs that ratios to a filter need.

    The verdicts of a study have those that ratios to an optimum need.
    """
    parts: list[Table | str] = []
    for (name, others), table in zip(against.items(), against_tables(against), strict=True):
        parts += ["", table]
        ates = {label: figures["ate_m"] for label, figures in others.items() if "ate_m" in figures}
        for label, ate in ({} if is_optimum(name) else ates).items():
            needed = "" if ate.ratio is None or _excludes_1(ate.ratio) else needed_runs(ate.ratio, ate.runs)
            parts += [f"{label} against {name}: x ATE is not significant{needed}"] if needed else []
    return parts


def _cells(found: Paired | None, form: str) -> list[Cell]:
    if found is None:
        return [Cell(NO_FIGURE)] * 3
    p = found.p_value
    p_text = NO_FIGURE if p is None else f"<{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.2g}"
    return [figure(found.ratio, "{:.3f}"), figure(found.difference, form), Cell(p_text, p)]
