"""The error budget of a filter: `slamgauge budget`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli.common import USER_CODE, OfScenario, RootSeed, WithPage, Work, results_of, staged
from slamgauge.compare.estimators.registry import FILTERS
from slamgauge.compare.storage.result_files import BUDGET
from slamgauge.compare.studies import budget as budgets


@dataclass
class Command(OfScenario, WithPage):
    """The error budget: split a filter's error into its causes, on the same measurements.

    For example:
      slamgauge budget q1-long-dense --filter ekf --runs 100

    Attributes:
        out: Folder of budget.json, budget.png and budget.svg. If not given: results/budget-SCENARIO.
        lag: Add the rung of a fixed-lag smoother over this number of steps, between optimum and filter.
        runs: Number of runs.
    """

    out: Path | None = None
    filter: Annotated[
        str, tyro.conf.arg(help=f"The filter whose error is split: {', '.join(FILTERS)}. {USER_CODE}")
    ] = "ekf"
    lag: int | None = None
    runs: int = 20
    seed: RootSeed = 0
    work: Work = field(default_factory=Work)

    def run(self) -> int:
        scenario, out = self.load(), self.out or results_of("budget", self.scenario)
        with staged(out, BUDGET) as folder, self.work.executor() as executor:
            found = budgets.error_budget(scenario, self.filter, self.runs, self.seed, executor, self.lag)
            self.output.show(found.to_json(), budgets.budget_table(found), folder and folder / BUDGET)
        return self.finish(out, BUDGET)
