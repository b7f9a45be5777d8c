"""The metrics of estimates by key, and their columns in tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, Literal

from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.metric import BY_KEY, Column
from slamgauge.compare.scoring.runs import RAYS
from slamgauge.compare.scoring.table import MARK, Cell, Head, figure, marked

STORED = (*(key for key, each in BY_KEY.items() if each.stored), *(f"rays_{name}" for name in RAYS))
TableName = Literal["run", "study", "sweep"]


def measured(found: Measured, *, in_study: bool = False) -> dict[str, Any]:
    """Return the metrics of an estimate by key: all of a score, or those that studies store."""
    figures = {
        key: each.measure(found)
        for key, each in BY_KEY.items()
        if each.measure is not None and (each.stored or not in_study)
    }
    if not in_study:
        return figures
    rays = found.rays() or dict.fromkeys(RAYS)
    return figures | {f"rays_{name}": count for name, count in rays.items()}


def heads(table: TableName, *, bounded: bool = False) -> list[Column]:
    """Return the columns of metrics in a table, from the left; with those of bounds if `bounded`."""
    columns = [each.column for each in BY_KEY.values() if each.column is not None]
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
