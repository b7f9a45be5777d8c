"""Monte Carlo: `slamgauge study` and `budget`."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgauge.compare.cli.options import (
    USER_CODE,
    Folder,
    Overrides,
    OwnCode,
    RootSeed,
    Sampled,
    WithPage,
    Work,
    flattened,
    named_after,
    overridden_scenario,
    require_scenario,
    results_folder,
    split_names,
    write_page,
)
from slamgauge.compare.estimators.registry import BOUND, BOUNDS, FILTERS, HELP
from slamgauge.compare.storage.result_files import BUDGET, BUDGET_FILES, SUMMARY, SWEEP
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scenarios.scenario import Scenario
    from slamgauge.compare.scoring.runs import Runs
    from slamgauge.compare.studies.baseline import Gate as BaselineGate
    from slamgauge.compare.studies.summary import Request, Summary


@dataclass(frozen=True)
class WorkAnywhere(Work):
    """Where the runs are computed."""

    scheduler: str | None = None
    """A Dask scheduler, tcp://host:port or tls://host:port. Anyone who can reach it can run code on it and here."""

    def executor(self) -> AbstractContextManager[Executor]:
        """Return an executor of the workers of the scheduler, or of worker processes."""
        if self.scheduler is None:
            return super().executor()
        from slamgauge.compare.studies.executors import dask_cluster

        return dask_cluster(self.scheduler)


@dataclass(frozen=True)
class Gate:
    """A comparison with an earlier study, for continuous integration."""

    baseline: Path | None = None
    """summary.json of an earlier study with the same scenario and seed: exit status 1 if an estimator is worse."""

    fail_if_worse: str = "5%"
    """With --baseline: accepted increase of ATE and NEES."""


@dataclass
class Study(WithPage):
    """Monte Carlo: many independent runs, their statistics and figures. After an interruption, it continues.

    Exit status 1 if an estimator failed in a run; the other results are kept.

    For example:
      slamgauge study q1-long-dense --runs 100 --estimators ekf,riekf,causal
      slamgauge study q2-long-dense --runs 20 --sweep association.gate=1,9,100
    """

    scenario: Sampled

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

    def __call__(self) -> int:
        require_scenario(self.scenario)
        from slamgauge.compare.estimators.requests import ask

        asked = self.own_code.isolate(ask(split_names(self.estimators)))
        with continued_later():
            done = self._study(asked) if self.sweep is None else self._sweep(self.sweep, asked)
        return self.finish(self.out, SUMMARY if self.sweep is None else SWEEP, done=done)

    def _study(self, asked: list[Asked]) -> bool:
        """Run a study; return whether everything succeeded."""
        from slamgauge.compare.figures.publishing import write_study
        from slamgauge.compare.storage.staged_folder import require_ours
        from slamgauge.compare.studies.study import load_runs, run_study
        from slamgauge.compare.studies.summary import summary_table

        scenario = overridden_scenario(self.scenario, self.set)
        require_ours(self.out)
        gate = None if self.gate.baseline is None else self._open_gate(self.gate.baseline, scenario, asked)
        with self.work.executor() as executor:
            arguments = (scenario, self.runs, self.seed, asked, self.out, executor)
            summary = run_study(*arguments, against=split_names(self.against))
        summary = replace(summary, request=self._request())
        worse = gate is not None and is_worse(summary, gate)
        self.output.show(summary.to_json(), summary_table(summary))
        runs = load_runs(scenario, summary.runs, self.seed, asked, self.out)
        done = write_study(self.out, summary, runs, scenario.trajectory.step)
        return done and not summary.failures and not worse

    def _request(self, swept: str = "") -> Request:
        from slamgauge.compare.studies.summary import Request

        return Request(self.scenario, tuple(flattened(self.set)), self.estimators, swept)

    def _open_gate(self, path: Path, scenario: Scenario, asked: list[Asked]) -> BaselineGate:
        """Return the gate of the study with a baseline; refuse a wrong one before anything runs."""
        from slamgauge.compare.studies.baseline import figures_of, open_gate
        from slamgauge.compare.studies.store import digest

        if path.resolve() == (self.out / SUMMARY).resolve():
            raise UserError(f"{path}: this study would replace its baseline; give another --out")
        names, tolerance = [each.label for each in asked], share(self.gate.fail_if_worse)
        return open_gate(figures_of(path), names, digest(scenario, self.seed), tolerance, str(path))

    def _sweep(self, sweep: str, asked: list[Asked]) -> bool:
        """Run a study at each value; return whether everything succeeded."""
        from slamgauge.compare.figures.publishing import write_study, write_sweep
        from slamgauge.compare.studies.sweep import run_sweep, sweep_table

        if self.against or self.gate.baseline is not None:
            raise UserError("sweep: takes no --against and no --baseline; study a single value with them")
        drawn: list[bool] = []

        def finished(folder: Path, summary: Summary, runs: dict[str, Runs], step: float) -> None:
            summary = replace(summary, request=self._request(folder.name))
            drawn.append(write_study(folder, summary, runs, step))
            drawn.append(write_page(folder, SUMMARY, replace(self.page, open=False)))

        with self.work.executor() as executor:
            arguments = (self.scenario, flattened(self.set), sweep, self.runs, self.seed, asked, self.out, executor)
            result = run_sweep(*arguments, finished=finished)
        self.output.show(result.to_json(), sweep_table(result))
        failed = any(each.failures for each in result.summaries)
        return write_sweep(self.out, result) and all(drawn) and not failed


@dataclass
class Budget(WithPage):
    """The error budget: split a filter's error into its causes, on the same measurements.

    For example:
      slamgauge budget q1-long-dense --filter ekf --runs 100
    """

    scenario: Sampled

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

    def __call__(self) -> int:
        require_scenario(self.scenario)
        from slamgauge.compare.figures.publishing import draw_stored
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.studies.budget import budget_table, error_budget

        scenario = overridden_scenario(self.scenario, self.set)
        staged = results_folder(self.out, BUDGET_FILES, last=BUDGET)
        with staged as folder, self.work.executor() as executor:
            budget = error_budget(scenario, self.filter, self.runs, self.seed, executor, self.lag)
            self.output.show(budget.to_json(), budget_table(budget))
            if folder is not None:
                write_json(folder / BUDGET, budget.to_json())
        return self.finish(self.out, BUDGET, done=draw_stored(self.out, BUDGET))


def is_worse(summary: Summary, gate: BaselineGate) -> bool:
    """Print what has changed in a study since its baseline, and return whether anything is worse."""
    from slamgauge.compare.studies.baseline import false_alarms, figures_of

    lines, worse = gate.judge(figures_of(summary))
    print(*lines, false_alarms(gate.tolerance), sep="\n", file=sys.stderr)
    return bool(worse)


def share(text: str) -> float:
    """Return the number of a text like 5% or 0.05."""
    try:
        return float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        raise UserError(f"fail-if-worse: {text} is not a share; give for example 5% or 0.05") from None


@contextmanager
def continued_later() -> Generator[None]:
    """Add to an interrupt how the command continues."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("finished runs are stored; the same command continues from there") from None
