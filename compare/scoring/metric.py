"""Description of a metric: its key, meaning, sources and column."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from slamgauge.compare.scoring.aggregation import OverRuns
from slamgauge.compare.scoring.measured import Measured

TableName = Literal["run", "study", "sweep"]
Measure = Callable[[Measured], Any]  # returns a figure, or several as a dataclass or a tuple; None: unknown
UNITS = {"_m": "m", "_rad": "rad"}  # units of keys with these endings


@dataclass(frozen=True)
class Column:
    """Column of a metric in tables.

    Attributes:
        title: short head.
        name: full name, if it differs from the title.
        form: format of the figure of a run.
        mean_form: format of the mean over runs, if it differs.
        run: place from the left in the table of a run; None: not in this table.
        study: place in the table of a study.
        sweep: place in the table of a sweep.
        relative: whether filtered estimates are compared with the causal optimum, and marked if that is in doubt.
        of_bounds: whether the column is only in tables with a bound.
    """

    title: str
    name: str = ""
    form: str = "{:.3f}"
    mean_form: str = ""
    run: int | None = None
    study: int | None = None
    sweep: int | None = None
    relative: bool = False
    of_bounds: bool = False


@dataclass(frozen=True)
class Metric:
    """A figure of an estimate, or of an estimator over many runs.

    Attributes:
        key: name in metrics.json, summary.json and the store of a study.
        help: meaning, in a sentence.
        measure: function that computes it for a run; None: single runs do not have it.
        over_runs: function that aggregates it over runs; None: not in summary.json.
        stored: whether studies store it for every run.
        column: column in tables; None: in no table.
    """

    key: str
    help: str
    measure: Measure | None = None
    over_runs: OverRuns | None = None
    stored: bool = False
    column: Column | None = None

    @property
    def unit(self) -> str:
        """`m`, `rad`, `s`, or nothing."""
        return "s" if self.key.startswith("seconds") else UNITS.get(self.key[self.key.rfind("_") :], "")
