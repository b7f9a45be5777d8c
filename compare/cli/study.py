"""Many runs: `slamgauge study`."""

from __future__ import annotations

import sys
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli import common
from slamgauge.compare.estimators import requests
from slamgauge.compare.estimators.registry import BOUND, BOUNDS, HELP
from slamgauge.compare.figures import publishing
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.scoring import runs as stored_runs
from slamgauge.compare.storage.result_files import SUMMARY, SWEEP
from slamgauge.compare.studies import baseline as baselines
from slamgauge.compare.studies import executors, store, study, summary, sweep
from slamgauge.errors import UserError

Names = Annotated[str, tyro.conf.arg(help=f"{HELP} Also {BOUND} ({BOUNDS[BOUND].note}). {common.USER_CODE}")]


@dataclass(frozen=True)
class WorkAnywhere(common.Work):
    """Where the runs are computed.

    Attributes:
        scheduler: A Dask scheduler, tcp://host:port or tls://host:port. Anyone who can reach it can run code on it and
            here.
    """

    scheduler: str | None = None

    def executor(self) -> AbstractContextManager[Executor]:
        """Return an executor of the workers of the scheduler, or of worker processes."""
        return super().executor() if self.scheduler is None else executors.dask_cluster(self.scheduler)


@dataclass(frozen=True)
class Gate:
    """A comparison with an earlier study, for continuous integration.

    Attributes:
        baseline: summary.json of an earlier study with the same scenario and seed: exit status 1 if an estimator is
            worse.
        fail_if_worse: With --baseline: accepted increase of ATE and NEES.
    """

    baseline: Path | None = None
    fail_if_worse: str = "5%"

    def opened(self, names: list[str], digest: str, out: Path) -> baselines.Gate | None:
        """Return the gate of the study with that digest and these estimators; None without a baseline."""
        if self.baseline is None:
            return None
        if self.baseline.resolve() == (out / SUMMARY).resolve():
            raise UserError(f"{self.baseline}: this study would replace its baseline; give another --out")
        try:
            tolerance = float(self.fail_if_worse.removesuffix("%")) / (100.0 if "%" in self.fail_if_worse else 1.0)
        except ValueError:
            what = f"fail-if-worse: {self.fail_if_worse} is not a share"
            raise UserError(f"{what}; give for example 5% or 0.05") from None
        earlier = baselines.as_study(self.baseline)
        return baselines.open_gate(earlier, names, digest, tolerance, str(self.baseline))


@dataclass
class Command(common.OfScenario, common.WithPage):
    """Monte Carlo: many independent runs, their statistics and figures. After an interruption, it continues.

    Exit status 1 if an estimator failed in a run; the other results are kept.

    For example:
      slamgauge study q1-long-dense --runs 100 --estimators ekf,riekf,causal
      slamgauge study q2-long-dense --runs 20 --sweep association.gate=1,9,100

    Attributes:
        out: Folder of study.sqlite, summary.json and the figures. If not given: results/study-SCENARIO.
        runs: Number of runs. A larger number later adds the missing runs only.
        against: Comma-separated, from --estimators: compare the other estimators with these on the same runs, in ATE
            and NEES.
        sweep: Run a study at each value of a key, key=v1,v2,..., in a folder each, and write sweep.json and a figure.
    """

    out: Path | None = None
    runs: int = 100
    seed: common.RootSeed = 0
    estimators: Names = "ekf,riekf,causal"
    own_code: common.OwnCode = field(default_factory=common.OwnCode)
    against: str = ""
    gate: Gate = field(default_factory=Gate)
    sweep: str | None = None
    work: WorkAnywhere = field(default_factory=WorkAnywhere)

    def run(self) -> int:
        scenario, asked = self.load(), self.own_code.ask(self.estimators)
        out = self.out or common.results_of("study", self.scenario)
        done = self._study(scenario, asked, out) if self.sweep is None else self._sweep(self.sweep, asked, out)
        print(f"written to {out}", file=sys.stderr)
        return 0 if self.page.write(out, SUMMARY if self.sweep is None else SWEEP) and done else 1

    def _study(self, scenario: scenarios.Scenario, asked: list[requests.Asked], out: Path) -> bool:
        """Run a study; return whether everything succeeded."""
        names = [each.label for each in asked]
        gate = self.gate.opened(names, store.digest(scenario, self.seed), out)
        with self.work.executor() as executor:
            against = common.split_names(self.against)
            found = study.run_study(scenario, self.runs, self.seed, asked, out, executor, against=against)
        found = replace(found, request=self._request())
        worse = list[str]()
        if gate is not None:
            lines, worse = gate.judge(found)
            print(*lines, baselines.false_alarms(gate.tolerance), sep="\n", file=sys.stderr)
        self.output.show(found.to_json(), summary.summary_table(found))
        done = publishing.write_study(out, found, dict(found.loaded), scenario.trajectory.step)
        return done and not found.failures and not worse

    def _sweep(self, key: str, asked: list[requests.Asked], out: Path) -> bool:
        """Run a study at each value; return whether everything succeeded."""
        if self.against or self.gate.baseline is not None:
            raise UserError("sweep: takes no --against and no --baseline; study a single value with them")
        drawn: list[bool] = []

        def finished(folder: Path, found: summary.Summary, runs: dict[str, stored_runs.Runs], step: float) -> None:
            found = replace(found, request=self._request(folder.name))
            drawn.append(publishing.write_study(folder, found, runs, step))
            drawn.append(replace(self.page, open=False).write(folder, SUMMARY))

        settings = common.flattened(self.set)
        with self.work.executor() as executor:
            result = sweep.run_sweep(self.scenario, settings, key, self.runs, self.seed, asked, out, executor, finished)
        self.output.show(result.to_json(), sweep.sweep_table(result))
        return (
            publishing.write_sweep(out, result) and all(drawn) and not any(each.failures for each in result.summaries)
        )

    def _request(self, swept: str = "") -> summary.Request:
        return summary.Request(self.scenario, tuple(common.flattened(self.set)), self.estimators, swept)
