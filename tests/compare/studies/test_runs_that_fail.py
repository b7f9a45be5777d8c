"""Failures of runs: which ones a study stores, and which ones the same command tries again."""

from __future__ import annotations

import errno
import os
import re
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from multiprocessing.context import SpawnProcess
from unittest.mock import Mock

import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study import AGAIN
from slamgauge.compare.studies.study_run import Outcome, run_once, run_seed
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]

RUN_ONCE = "slamgauge.compare.studies.study.run_once"
BOTH = ("ekf", "riekf")


@pytest.mark.parametrize(
    ("error", "stored"),
    [
        (UserError("observation[3]: no update exists"), "estimator riekf: observation[3]: no update exists"),
        (IndexError("out of\nbounds"), "IndexError: out of bounds (PLACE; a defect of slamgauge, please report it)"),
    ],
)
def test_an_error_is_stored_as_a_line_that_distinguishes_mistakes_from_defects_and_not_repeated(
    scenario: Scenario, run: Run, monkeypatch: pytest.MonkeyPatch, error: Exception, stored: str
) -> None:
    riekf = load_estimators(["riekf"])["riekf"]
    estimates = [riekf(simulate(scenario, run_seed(0, number))[1]) for number in (0, 2)]
    monkeypatch.setattr("slamgauge.ekf.riekf", Mock(side_effect=[estimates[0], error, estimates[1]]))
    for _ in range(2):
        summary = run(3, BOTH)
        (failure,) = summary.failures
        assert (failure.run, failure.estimator) == (1, "riekf")
        assert re.sub(r"\w+\.py, line \d+", "PLACE", failure.error) == stored
        assert (summary.estimators["ekf"]["runs"], summary.estimators["riekf"]["runs"]) == (3, 2)


@pytest.mark.parametrize("error", [MemoryError("too large"), OSError(errno.ENOSPC, "No space left on device")])
@pytest.mark.parametrize("place", ["slamgauge.ekf.riekf", "slamgauge.compare.studies.study_run.simulate_informed"])
def test_a_failure_of_the_machine_is_reported_and_the_same_command_repeats_the_run(
    run: Run, monkeypatch: pytest.MonkeyPatch, place: str, error: Exception
) -> None:
    """What did not fail is stored."""
    with monkeypatch.context() as patched:
        patched.setattr(place, Mock(side_effect=error))
        summary = run(1, BOTH)
    line = f"{type(error).__name__}: {error} ({AGAIN})"
    failed = [("riekf", line)] if "riekf" in place else [(name, f"simulation: {line}") for name in BOTH]
    assert [(each.estimator, each.error) for each in summary.failures] == failed
    assert summary.estimators["ekf"]["runs"] == (1 if "riekf" in place else 0)
    again = run(1, BOTH)
    assert not again.failures
    assert again.estimators["riekf"]["runs"] == 1


def test_an_estimator_that_changes_the_kind_of_its_estimates_is_refused_with_all_its_runs(run: Run, load: Load) -> None:
    ekf, asked = load_estimators(["ekf"])["ekf"], []

    def changing(recording: Recording) -> Estimate:
        asked.append(recording)
        return replace(ekf(recording), kind="smoothed" if len(asked) > 2 else "filtered")

    chosen = {"ekf": "ekf", "mine": changing}
    assert not run(2, chosen).failures
    summary = run(4, chosen, against=["ekf"])
    (failure,) = summary.failures
    assert (failure.run, failure.estimator) == (2, "mine")
    assert failure.error == (
        "its poses are filtered in run 0 and smoothed in run 2; "
        "none of its runs counts: return the same kind in every run"
    )
    assert (summary.estimators["mine"]["kind"], summary.estimators["mine"]["runs"]) == (None, 0)
    assert len(load(4, chosen)["mine"].run) == 0
    assert summary.estimators["ekf"]["runs"] == 4
    assert summary.against == {"ekf": {"mine": {}}}
    assert "run 2: mine failed: its poses are" in str(summary_table(summary))


def test_workers_that_always_die_are_one_line_and_stored_runs_are_kept(
    run: Run, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(1, ("ekf",))
    monkeypatch.setattr(RUN_ONCE, leave_at_once)
    line = r"^a worker process died 3 times in a row, the last time at run 3 alone .*; make room, and give the same"
    with pytest.raises(UserError, match=line), local_processes(1) as executor:
        run(6, ("ekf",), executor=executor)
    assert load(6, ("ekf",))["ekf"].run.tolist() == [0]


def test_a_run_that_kills_its_worker_is_named_and_the_others_continue(
    run: Run, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched, local_processes(1) as executor:
        patched.setattr(RUN_ONCE, leave_at_run_1)
        summary = run(4, BOTH, executor=executor)
    assert [(each.run, each.estimator) for each in summary.failures] == [(1, "ekf"), (1, "riekf")]
    assert {each.error for each in summary.failures} == {f"its worker process died (out of memory?) ({AGAIN})"}
    assert load(4, ("ekf",))["ekf"].run.tolist() == [0, 2, 3]
    with local_processes(1) as executor:
        again = run(4, BOTH, executor=executor)
    assert (again.failures, again.estimators["ekf"]["runs"]) == ((), 4)


def test_a_worker_that_dies_while_another_starts_loses_only_its_own_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """The queue of the starting worker is closed by then."""
    start, refusals = SpawnProcess.start, [OSError("handle is closed")]

    def refused_once(process: SpawnProcess) -> None:
        if refusals:
            raise refusals.pop()
        start(process)

    with local_processes(2) as executor:
        own = executor.submit(time.sleep, 100.0)
        monkeypatch.setattr(SpawnProcess, "start", refused_once)
        assert executor.submit(abs, -3).result(60.0) == 3
        assert isinstance(own.exception(60.0), BrokenExecutor)
    assert not refusals


def leave_at_once(*_: object) -> None:
    os._exit(1)


def leave_at_run_1(scenario: Scenario, seed: int, names: Sequence[str]) -> list[Outcome]:
    if seed == run_seed(0, 1):
        os._exit(1)
    return run_once(scenario, seed, names)
