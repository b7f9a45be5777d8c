"""Description of a metric: its key, meaning, sources and column."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from slamgauge.compare.scoring.aggregation import OverRuns
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

Table = Literal["run", "study", "sweep"]
Measure = Callable[[Truth, Recording, Estimate], Any]  # returns a figure, or JSON of several; None: unknown
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
        scored: whether single runs have it, in metrics.json.
        stored: whether studies store it for every run.
        over_runs: how summary.json aggregates it over runs; None: not in summary.json.
        column: column in tables; None: in no table.
        measure: function that computes it, if `Score` has no field for it.
    """

    key: str
    help: str
    scored: bool = False
    stored: bool = False
    over_runs: OverRuns | None = None
    column: Column | None = None
    measure: Measure | None = None

    @property
    def unit(self) -> str:
        """`m`, `rad`, `s`, or nothing."""
        return "s" if self.key.startswith("seconds") else UNITS.get(self.key[self.key.rfind("_") :], "")
