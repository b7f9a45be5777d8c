"""Many runs: `slamgauge study`."""

from __future__ import annotations

import sys
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from slamgauge.compare.cli.options.shared import flattened, split_names
from slamgauge.compare.cli.options.study import Study, WorkAnywhere
from slamgauge.compare.cli.steps import continued_later, executor_of, finish, isolated, overridden_scenario, write_page
from slamgauge.compare.estimators.requests import Asked, ask
from slamgauge.compare.figures.publishing import write_study, write_sweep
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.result_files import SUMMARY, SWEEP
from slamgauge.compare.storage.staged_folder import require_ours
from slamgauge.compare.studies.baseline import Gate as BaselineGate
from slamgauge.compare.studies.baseline import as_study, false_alarms, open_gate
from slamgauge.compare.studies.executors import dask_cluster
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.summary import Request, Summary, summary_table
from slamgauge.compare.studies.sweep import run_sweep, sweep_table
from slamgauge.errors import UserError


def run(command: Study) -> int:
    """Run the command; return the exit status."""
    asked = isolated(ask(split_names(command.estimators)), command.own_code)
    with continued_later():
        done = _study(command, asked) if command.sweep is None else _sweep(command, command.sweep, asked)
    return finish(command, command.out, SUMMARY if command.sweep is None else SWEEP, done=done)


def _study(command: Study, asked: list[Asked]) -> bool:
    """Run a study; return whether everything succeeded."""
    scenario = overridden_scenario(command.scenario, command.set)
    require_ours(command.out)
    gate = None if command.gate.baseline is None else _open_gate(command, command.gate.baseline, scenario, asked)
    with _executor(command.work) as executor:
        arguments = (scenario, command.runs, command.seed, asked, command.out, executor)
        summary = run_study(*arguments, against=split_names(command.against))
    summary = replace(summary, request=_request(command))
    worse = gate is not None and is_worse(summary, gate)
    command.output.show(summary.to_json(), summary_table(summary))
    runs = load_runs(scenario, summary.runs, command.seed, asked, command.out)
    done = write_study(command.out, summary, runs, scenario.trajectory.step)
    return done and not summary.failures and not worse


def _request(command: Study, swept: str = "") -> Request:
    return Request(command.scenario, tuple(flattened(command.set)), command.estimators, swept)


def _open_gate(command: Study, path: Path, scenario: Scenario, asked: list[Asked]) -> BaselineGate:
    """Return the gate of the study with a baseline; refuse a wrong one before anything runs."""
    if path.resolve() == (command.out / SUMMARY).resolve():
        raise UserError(f"{path}: this study would replace its baseline; give another --out")
    names, tolerance = [each.label for each in asked], share(command.gate.fail_if_worse)
    return open_gate(as_study(path), names, digest(scenario, command.seed), tolerance, str(path))


def _sweep(command: Study, sweep: str, asked: list[Asked]) -> bool:
    """Run a study at each value; return whether everything succeeded."""
    if command.against or command.gate.baseline is not None:
        raise UserError("sweep: takes no --against and no --baseline; study a single value with them")
    drawn: list[bool] = []

    def finished(folder: Path, summary: Summary, runs: dict[str, Runs], step: float) -> None:
        summary = replace(summary, request=_request(command, folder.name))
        drawn.append(write_study(folder, summary, runs, step))
        drawn.append(write_page(folder, SUMMARY, replace(command.page, open=False)))

    with _executor(command.work) as executor:
        arguments = (
            command.scenario,
            flattened(command.set),
            sweep,
            command.runs,
            command.seed,
            asked,
            command.out,
            executor,
        )
        result = run_sweep(*arguments, finished=finished)
    command.output.show(result.to_json(), sweep_table(result))
    failed = any(each.failures for each in result.summaries)
    return write_sweep(command.out, result) and all(drawn) and not failed


def _executor(work: WorkAnywhere) -> AbstractContextManager[Executor]:
    """Return an executor of the workers of the scheduler, or of worker processes."""
    return executor_of(work) if work.scheduler is None else dask_cluster(work.scheduler)


def is_worse(summary: Summary, gate: BaselineGate) -> bool:
    """Print what has changed in a study since its baseline, and return whether anything is worse."""
    lines, worse = gate.judge(summary)
    print(*lines, false_alarms(gate.tolerance), sep="\n", file=sys.stderr)
    return bool(worse)


def share(text: str) -> float:
    """Return the number of a text like 5% or 0.05."""
    try:
        return float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        raise UserError(f"fail-if-worse: {text} is not a share; give for example 5% or 0.05") from None
