"""The error budget of a filter: `slamgauge budget`."""

from __future__ import annotations

from slamgauge.compare.cli.options.study import Budget
from slamgauge.compare.cli.steps import draw, executor_of, finish, overridden_scenario, results_folder
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.result_files import BUDGET
from slamgauge.compare.studies.budget import budget_table, error_budget


def run(command: Budget) -> int:
    """Run the command; return the exit status."""
    scenario = overridden_scenario(command.scenario, command.set)
    staged = results_folder(command.out, BUDGET)
    with staged as folder, executor_of(command.work) as executor:
        budget = error_budget(scenario, command.filter, command.runs, command.seed, executor, command.lag)
        command.output.show(budget.to_json(), budget_table(budget))
        if folder is not None:
            write_json(folder / BUDGET, budget.to_json())
    return finish(command, command.out, BUDGET, done=draw(command.out, BUDGET))
