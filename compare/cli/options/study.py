"""Options of `slamgauge study` and `budget`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli.options.shared import (
    USER_CODE,
    Folder,
    OfScenario,
    Overrides,
    OwnCode,
    RootSeed,
    WithPage,
    Work,
    named_after,
)
from slamgauge.compare.estimators.registry import BOUND, BOUNDS, FILTERS, HELP


@dataclass(frozen=True)
class WorkAnywhere(Work):
    """Where the runs are computed."""

    scheduler: str | None = None
    """A Dask scheduler, tcp://host:port or tls://host:port. Anyone who can reach it can run code on it and here."""


@dataclass(frozen=True)
class Gate:
    """A comparison with an earlier study, for continuous integration."""

    baseline: Path | None = None
    """summary.json of an earlier study with the same scenario and seed: exit status 1 if an estimator is worse."""

    fail_if_worse: str = "5%"
    """With --baseline: accepted increase of ATE and NEES."""


@dataclass
class Study(OfScenario, WithPage):
    """Monte Carlo: many independent runs, their statistics and figures. After an interruption, it continues.

    Exit status 1 if an estimator failed in a run; the other results are kept.

    For example:
      slamgauge study q1-long-dense --runs 100 --estimators ekf,riekf,causal
      slamgauge study q2-long-dense --runs 20 --sweep association.gate=1,9,100
    """

    out: Folder = Path("results/study-NAME")
    """Folder of study.sqlite, summary.json and the figures."""

    runs: int = 100
    """Number of runs. A larger number later adds the missing runs only."""

    seed: RootSeed = 0

    estimators: Annotated[str, tyro.conf.arg(help=f"{HELP} Also {BOUND} ({BOUNDS[BOUND].note}). {USER_CODE}")] = (
        "ekf,riekf,causal"
    )

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Overrides = field(default_factory=list)

    against: str = ""
    """Comma-separated, from --estimators: compare the other estimators with these on the same runs, in ATE and NEES."""

    gate: Gate = field(default_factory=Gate)

    sweep: str | None = None
    """Run a study at each value of a key, key=v1,v2,..., in a folder each, and write sweep.json and a figure."""

    work: WorkAnywhere = field(default_factory=WorkAnywhere)

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.scenario)


@dataclass
class Budget(OfScenario, WithPage):
    """The error budget: split a filter's error into its causes, on the same measurements.

    For example:
      slamgauge budget q1-long-dense --filter ekf --runs 100
    """

    out: Folder = Path("results/budget-NAME")
    """Folder of budget.json, budget.png and budget.svg."""

    filter: Annotated[
        str,
        tyro.conf.arg(
            help=f"The filter whose error is split: {', '.join(FILTERS)}. {USER_CODE}", aliases=["--estimators"]
        ),
    ] = "ekf"

    lag: int | None = None
    """Add the rung of a fixed-lag smoother over this number of steps, between optimum and filter."""

    runs: int = 20
    """Number of runs."""

    seed: RootSeed = 0

    set: Overrides = field(default_factory=list)

    work: Work = field(default_factory=Work)

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.scenario)
