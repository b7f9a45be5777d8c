"""Declaration of metrics: a decorated function computes the figure, its name is the key, its docstring the meaning.

Decorated are methods of `Measured` for runs, and methods of `Runs` for studies. `Score` (a run), `EstimatorSummary` (a
study), their files, stores, tables and pages, and the manual (`docs/make_tables.py`) follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from slamgauge.compare.scoring.intervals import mean_interval
from slamgauge.compare.scoring.table import Head

Measure = Callable[[Any], Any]  # argument: `Measured`; returns a figure, or several as a dictionary or a tuple
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
    measure: Measure | None = None  # None: not in metrics.json
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
