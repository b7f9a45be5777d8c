"""Columns of metrics in the tables of runs, studies and sweeps, as the entries of the catalogue state them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from slamgauge.compare.scoring import catalogue
from slamgauge.compare.scoring.metric import TableName
from slamgauge.compare.scoring.table import MARK, Cell, Head, figure, marked


def heads(table: TableName, *, bounded: bool = False) -> list[Head]:
    """Return the columns of metrics in a table, from the left; with those of bounds if `bounded`."""
    found: list[tuple[int, Head]] = []
    for each in catalogue.CATALOGUE:
        column = each.column
        place = None if column is None else getattr(column, table)
        if column is not None and place is not None and (bounded or not column.of_bounds):
            form = column.form if table == "run" else column.mean_form or column.form
            found.append((place, Head(column.title, column.name, each.help, key=each.key, form=form)))
    return [head for _, head in sorted(found, key=lambda pair: pair[0])]


def _is_relative(key: str) -> bool:
    """Return whether a metric compares with the optimum of the same kind."""
    column = catalogue.BY_KEY[key].column
    return column is not None and column.relative


def figure_cells(entry: Mapping[str, Any], columns: list[Head], is_marked: bool | None) -> list[Cell]:
    """Return the cells of an estimator in columns of metrics; None leaves no room for marks.

    Figures relative to an optimum are marked if it is in doubt.
    """
    cells = [figure(entry[head.key], head.form) for head in columns]
    if is_marked is None:
        return cells
    return [
        marked(each, MARK, is_marked=is_marked) if _is_relative(head.key) else each
        for each, head in zip(cells, columns, strict=True)
    ]


def empty_columns(columns: list[Head], is_empty: Callable[[str], bool]) -> list[str]:
    """Return a line that names the columns without any figure; no line if every column has one."""
    names = [head.full for head in columns if is_empty(head.key)]
    return [f"Empty columns: {', '.join(names)} (docs/your_filter.md lists what each needs)"] if names else []
