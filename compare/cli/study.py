"""Monte Carlo: `slamgauge study`, `budget` and `claims`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgauge.compare.cli.options import (
    Estimators,
    FilterName,
    Folder,
    Overrides,
    OwnCode,
    Work,
    carried_by,
    flattened,
    named_after,
    print_result,
    results_folder,
    sampled_scenario,
    split_names,
)
from slamgauge.compare.cli.pages import PageOptions, write_page
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.storage.result_files import BUDGET, BUDGET_FILES, CLAIMS, SUMMARY, SWEEP
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scoring.runs import Runs
    from slamgauge.compare.studies.summary import Summary


@dataclass(frozen=True)
class WorkAnywhere(Work):
    """Who carries out the runs."""

    scheduler: str | None = None
    """Address of a Dask scheduler, tcp://host:port or tls://host:port, whose workers carry the runs instead. Whoever
    reaches it can have code run there and here."""


@dataclass
class Study:
    """Monte Carlo: many independent runs, their statistics and figures. Interrupted, it goes on where it was.

    Exit status 1 if an estimator failed in a run; all others are summed up.

    For example:
      slamgauge study q1-long-dense --runs 100 --estimators ekf,riekf,causal
      slamgauge study q2-long-dense --runs 20 --sweep association.gate=1,9,100
    """

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file; the true start is drawn
    from the prior unless --set start=mean."""

    out: Folder = Path("results/study-NAME")
    """Folder of study.sqlite, summary.json and the figures."""

    runs: int = 100
    """How many runs; give more later, and only those are carried out."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    estimators: Estimators = "ekf,riekf,causal"

    own_code: OwnCode = field(default_factory=OwnCode)

    set: Overrides = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    against: str = ""
    """Comma-separated, of --estimators: whom the others are compared with run by run, in ATE and NEES."""

    precision: float | None = None
    """Go on after --runs until the half-width of the interval of every ratio of ATEs, to those of --against or else to
    the optima, is below this share of it, 0.02 for instance. The intervals hold wherever that is."""

    max_runs: int = 2000
    """With --precision: how many runs at most."""

    sweep: str | None = None
    """A study at each value of a key, key=v1,v2,..., in a folder each; sweep.json and a figure beside them."""

    work: WorkAnywhere = field(default_factory=WorkAnywhere)

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.scenario)

    def __call__(self) -> int:
        """Run what is missing, sum up, print and write; the exit status."""
        try:
            done = self._study() if self.sweep is None else self._sweep(self.sweep)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("what is done is stored; the same command goes on from there") from None
        print(f"written to {self.out}", file=sys.stderr)
        beside = SUMMARY if self.sweep is None else SWEEP
        explained = write_page(self.out, beside, self.page)
        return 0 if done and explained else 1

    def _asked(self) -> list[Asked]:
        from slamgauge.compare.estimators.requests import ask

        return self.own_code.kept_apart(ask(split_names(self.estimators)))

    def _study(self) -> bool:
        """Carry out a study; whether nothing has failed."""
        from slamgauge.compare.figures.publishing import write_study
        from slamgauge.compare.storage.manifest import require_free
        from slamgauge.compare.storage.result_files import STUDY_FILES
        from slamgauge.compare.studies.stopping_rule import Until
        from slamgauge.compare.studies.study import load_runs, run_study
        from slamgauge.compare.studies.summary import summary_table

        scenario, asked = sampled_scenario(self.scenario, self.set), self._asked()
        require_free(self.out, STUDY_FILES)
        with carried_by(self.work.jobs, self.work.scheduler) as executor:
            until = None if self.precision is None else Until(self.precision, self.max_runs)
            arguments = (scenario, self.runs, self.seed, asked, self.out, executor)
            summary = run_study(*arguments, against=split_names(self.against), until=until)
        printed = print_result(summary.to_json() if self.output.json else summary_table(summary))
        runs = load_runs(scenario, summary.runs, self.seed, asked, self.out)
        return write_study(self.out, summary, runs, scenario.trajectory.step) and printed and not summary.failures

    def _sweep(self, sweep: str) -> bool:
        """Carry out a study at each value; whether nothing has failed."""
        from slamgauge.compare.figures.publishing import write_study, write_sweep
        from slamgauge.compare.studies.sweep import run_sweep, sweep_table

        if self.against or self.precision is not None:
            raise UserError("sweep: takes no --against and no --precision; leave them out, or study a single value")
        overrides, asked = ["start=sampled", *flattened(self.set)], self._asked()
        drawn: list[bool] = []

        def finished(folder: Path, summary: Summary, runs: dict[str, Runs], step: float) -> None:
            drawn.append(write_study(folder, summary, runs, step))
            drawn.append(write_page(folder, SUMMARY, replace(self.page, open=False)))

        with carried_by(self.work.jobs, self.work.scheduler) as executor:
            arguments = (self.scenario, overrides, sweep, self.runs, self.seed, asked, self.out, executor)
            result = run_sweep(*arguments, finished=finished)
        printed = print_result(result.to_json() if self.output.json else sweep_table(result))
        failed = any(each.failures for each in result.summaries)
        return write_sweep(self.out, result) and all(drawn) and printed and not failed


@dataclass
class Budget:
    """The error budget: where a filter's error comes from, rung by rung, on the same measurements.

    For example:
      slamgauge budget q1-long-dense --filter ekf --runs 100
    """

    scenario: tyro.conf.Positional[str]
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file; the true start is drawn
    from the prior unless --set start=mean."""

    out: Folder = Path("results/budget-NAME")
    """Folder of budget.json, budget.png and budget.svg."""

    filter: FilterName = "ekf"

    lag: int | None = None
    """Add the rung of a smoother of so many steps (fixed-lag), between optimum and filter."""

    runs: int = 20
    """How many runs."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    set: Overrides = field(default_factory=list)
    """Override keys of the scenario: dotted.key=value ..."""

    work: Work = field(default_factory=Work)

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __post_init__(self) -> None:
        self.out = named_after(self.out, self.scenario)

    def __call__(self) -> int:
        """Run, print and write; the exit status."""
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.studies.budget import budget_table, error_budget

        scenario = sampled_scenario(self.scenario, self.set)
        staged = results_folder(self.out, BUDGET_FILES, last=BUDGET)
        with staged as folder, carried_by(self.work.jobs) as executor:
            budget = error_budget(scenario, self.filter, self.runs, self.seed, executor, self.lag)
            printed = print_result(budget.to_json() if self.output.json else budget_table(budget))
            if folder is not None:
                write_json(folder / BUDGET, budget.to_json())
        from slamgauge.compare.figures.publishing import draw_stored

        drawn = draw_stored(self.out, BUDGET)
        print(f"written to {self.out}", file=sys.stderr)
        explained = write_page(self.out, BUDGET, self.page)
        return 0 if printed and drawn and explained else 1


@dataclass
class Claims:
    """The practical's conclusions, each tested over as many runs as it takes to decide. Interrupted, it goes on.

    For example:
      slamgauge claims
      slamgauge claims --runs 20 --max-runs 20
    """

    out: Folder = Path("results/claims")
    """Folder of claims.json and of the studies behind it."""

    runs: int = 20
    """How many runs of each setting at first. Claims that are undecided then go on, to half as many more each time;
    verdicts hold wherever that ends."""

    max_runs: int = 3000
    """How many runs at most, if that is more than --runs."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned."""

    work: Work = field(default_factory=Work)

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Run what is missing, judge, print and write; the exit status."""
        from slamgauge.compare.studies.claims import claims_table, judge_claims, write_claims

        try:
            with carried_by(self.work.jobs) as executor:
                claims = judge_claims(self.runs, self.seed, self.out, executor, self.max_runs)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("what is done is stored; the same command goes on from there") from None
        content = [each.to_json() for each in claims.judgements]
        printed = print_result(content if self.output.json else claims_table(claims))
        write_claims(self.out, claims)
        print(f"written to {self.out}", file=sys.stderr)
        explained = write_page(self.out, CLAIMS, self.page)
        return 0 if printed and explained else 1
