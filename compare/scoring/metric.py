"""Declaration of metrics: a decorated function computes the figure, its name is the key, its docstring the meaning.

Decorated are methods of `Measured` for runs, and functions of `runs.Runs` for studies. `Score` (a run),
`EstimatorSummary` (a study), their files, stores, tables and pages, and the manual (`docs/make_tables.py`) follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from slamgauge.compare.scoring.intervals import mean_interval
from slamgauge.compare.scoring.table import Head

TableName = Literal["run", "study", "sweep"]
Measure = Callable[[Any], Any]  # argument: `Measured`; returns a figure, or several as a dataclass or a tuple
OverRuns = Callable[[Any, Mapping[str, Any]], Any]  # arguments: `Runs` of the estimator, and those of all by name
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

    key: str  # in metrics.json, summary.json and the store of a study
    help: str
    measure: Measure | None = None  # None: not in metrics.json
    over_runs: OverRuns | None = None  # None: not in summary.json
    stored: bool = False  # by studies, for every run
    column: Column | None = None  # in tables


DECLARED: dict[str, Metric] = {}


def of_run(
    column: Column | None = None, over_runs: OverRuns | None = None, *, stored: bool = False, averaged: bool = False
) -> Callable[[Function], Function]:
    """Declare a figure of runs: aggregated by `over_runs`, `stored` by studies, or stored and `averaged` by them."""

    def declare(measure: Function) -> Function:
        key = measure.__name__
        mean = (lambda runs, _: mean_interval(runs.figures[key])) if averaged else over_runs
        DECLARED[key] = Metric(key, _meaning(measure), measure, mean, stored or averaged, column)
        return measure

    return declare


def of_study(column: Column | None = None) -> Callable[[Function], Function]:
    """Declare a figure of many runs."""

    def declare(aggregate: Function) -> Function:
        key = aggregate.__name__
        DECLARED[key] = Metric(key, _meaning(aggregate), over_runs=aggregate, column=column)
        return aggregate

    return declare


def _meaning(function: Callable[..., Any]) -> str:
    return " ".join((function.__doc__ or "").split()).removesuffix(".")
