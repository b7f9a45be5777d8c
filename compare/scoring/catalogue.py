"""List of all metrics, and their columns in tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.metric import DECLARED, Column, Metric, TableName
from slamgauge.compare.scoring.ray_figures import RAY_FIGURES, mean_rays, ray_figures
from slamgauge.compare.scoring.table import MARK, Cell, Head, figure, marked
from slamgauge.compare.scoring.verdicts import faults_over_runs, verdict_on_run, verdict_over_runs

OTHERS = (
    Metric("rays", "Result of the rays of a bearing-only estimate (`ray_figures.RayFigures`)", ray_figures, mean_rays),
    Metric("verdict", "Conclusions from the figures, in words (`verdicts`)", verdict_on_run, verdict_over_runs),
    Metric("faults", "Faults in a few words, without sizes (`verdicts`)", over_runs=faults_over_runs),
)
BY_KEY = DECLARED
BY_KEY.update({each.key: each for each in OTHERS})
STORED = (*(key for key, each in BY_KEY.items() if each.stored), *(f"rays_{name}" for name in RAY_FIGURES))


def measured(found: Measured, *, in_study: bool = False) -> dict[str, Any]:
    """Return the metrics of an estimate by key: all of a score, or those that studies store."""
    figures = {
        key: each.measure(found)
        for key, each in BY_KEY.items()
        if each.measure is not None and (each.stored or not in_study)
    }
    if not in_study:
        return figures
    rays = ray_figures(found)
    return figures | {f"rays_{name}": getattr(rays, name, None) for name in RAY_FIGURES}


def heads(table: TableName, *, bounded: bool = False) -> list[Column]:
    """Return the columns of metrics in a table, from the left; with those of bounds if `bounded`."""
    columns = [replace(each.column, key=key, help=each.help) for key, each in BY_KEY.items() if each.column is not None]
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
