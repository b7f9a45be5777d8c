"""What a catalogue says of a figure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from slamgauge.compare.scoring.aggregation import OverRuns
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

Table = Literal["run", "study", "sweep"]
Measure = Callable[[Truth, Recording, Estimate], Any]  # a figure, or what JSON has for several; None: unknown


@dataclass(frozen=True, kw_only=True)
class Column:
    """How a figure stands in tables.

    Attributes:
        title: its head.
        form: how the figure of a run is written.
        mean_form: how its mean over runs is, if not so.
        run: place in the table of a run, from the left; None leaves it out.
        study: place in the table of a study.
        sweep: place in the table of a sweep.
        relative: whether the figure is one against the causal optimum, of filtered estimates at least, and is marked
            where that optimum is in doubt.
        of_bounds: whether it stands only in tables with a bound.
    """

    title: str
    form: str = "{:.3f}"
    mean_form: str = ""
    run: int | None = None
    study: int | None = None
    sweep: int | None = None
    relative: bool = False
    of_bounds: bool = False


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A figure of an estimate, or of an estimator over many runs.

    Attributes:
        key: its name in metrics.json, summary.json and in the store of a study.
        help: what it is, in a sentence.
        unit: `m`, `rad`, `s`, or nothing.
        scored: whether it is a figure of single runs, in metrics.json.
        stored: whether studies keep it of every run.
        over_runs: how it is summed up over runs, in summary.json; None: it is not.
        column: how it stands in tables; None: in none.
        measure: where it comes from, for a figure that `Score` has no field for.
    """

    key: str
    help: str
    unit: str = ""
    scored: bool = False
    stored: bool = False
    over_runs: OverRuns | None = None
    column: Column | None = None
    measure: Measure | None = None
