"""Which failures a study keeps, and which the same command tries again: the machine's, not the input's."""

from __future__ import annotations

import errno
import os
import re
import time
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing.context import SpawnProcess
from pathlib import Path
from unittest.mock import Mock

import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.executors import local_processes, lost_worker
from slamgauge.compare.studies.stopping_rule import Until
from slamgauge.compare.studies.study import AGAIN, load_runs, run_study
from slamgauge.compare.studies.study_run import Outcome, run_once, run_seed
from slamgauge.compare.studies.summary import summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

RUN_ONCE = "slamgauge.compare.studies.study.run_once"


@pytest.mark.parametrize(
    ("error", "kept"),
    [
        (UserError("observation[3]: no update exists"), "estimator ekf: observation[3]: no update exists"),
        (IndexError("out of\nbounds"), "IndexError: out of bounds (PLACE; a defect of slamgauge, please report it)"),
    ],
)
def test_a_failure_is_one_line_that_tells_mistakes_from_defects(
    scenario: Scenario,
    thread: ThreadPoolExecutor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    kept: str,
) -> None:
    def broken(_: Recording, **__: object) -> Estimate:
        raise error

    monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
    (failure,) = run_study(scenario, 1, 0, ("ekf",), tmp_path, thread).failures
    assert re.sub(r"test_runs_that_fail\.py, line \d+", "PLACE", failure.error) == kept


@pytest.mark.parametrize("error", [MemoryError("too large"), OSError(errno.ENOSPC, "No space left on device")])
def test_what_the_machine_refuses_is_named_and_carried_out_by_the_same_command(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """One estimator's result of the run is stored, the other's is not."""
    whole = run_study(scenario, 3, 0, ("ekf", "riekf"), tmp_path / "whole", thread)
    riekf = load_estimators(["riekf"])["riekf"]
    estimates = [riekf(simulate(scenario, run_seed(0, run))[1]) for run in (1, 2)]
    with monkeypatch.context() as patched:
        patched.setattr("slamgauge.ekf.riekf", Mock(side_effect=[error, *estimates]))
        summary = run_study(scenario, 3, 0, ("ekf", "riekf"), tmp_path / "parts", thread)
    (failure,) = summary.failures
    assert (failure.run, failure.estimator, failure.error) == (0, "riekf", f"{type(error).__name__}: {error} ({AGAIN})")
    assert (summary.estimators["ekf"].runs, summary.estimators["riekf"].runs) == (3, 2)
    again = run_study(scenario, 3, 0, ("ekf", "riekf"), tmp_path / "parts", thread)
    assert not again.failures
    assert again.estimators["riekf"].ate_m == whole.estimators["riekf"].ate_m


def test_a_simulation_without_memory_is_named_for_every_estimator_and_tried_again(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(study_run, "simulate_informed", Mock(side_effect=MemoryError("too large")))
        summary = run_study(scenario, 1, 0, ("ekf", "riekf"), tmp_path, thread)
    assert [failure.error for failure in summary.failures] == [f"simulation: MemoryError: too large ({AGAIN})"] * 2
    assert not run_study(scenario, 1, 0, ("ekf", "riekf"), tmp_path, thread).failures


def test_a_simulation_that_fails_is_recorded_for_every_estimator(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(study_run, "simulate_informed", Mock(side_effect=UserError("seed: too large")))
        summary = run_study(scenario, 1, 0, ("ekf", "riekf"), tmp_path, thread)
    assert [failure.error for failure in summary.failures] == ["simulation: seed: too large"] * 2
    assert run_study(scenario, 1, 0, ("ekf", "riekf"), tmp_path, thread).failures == summary.failures


def test_an_estimator_that_changes_the_kind_of_its_estimates_is_refused_with_all_its_runs(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    ekf, asked = load_estimators(["ekf"])["ekf"], []

    def changing(recording: Recording) -> Estimate:
        asked.append(recording)
        return replace(ekf(recording), kind="smoothed" if len(asked) > 2 else "filtered")

    chosen = {"ekf": "ekf", "mine": changing}
    assert not run_study(scenario, 2, 0, chosen, tmp_path, thread).failures
    summary = run_study(scenario, 4, 0, chosen, tmp_path, thread, against=["ekf"], until=Until(0.5, 4))
    (failure,) = summary.failures
    assert (failure.run, failure.estimator) == (2, "mine")
    assert failure.error == (
        "its poses are filtered in run 0 and smoothed in run 2; "
        "none of its runs counts: return the same kind in every run"
    )
    assert (summary.estimators["mine"].kind, summary.estimators["mine"].runs) == (None, 0)
    assert len(load_runs(scenario, 4, 0, chosen, tmp_path)["mine"].run) == 0
    assert summary.estimators["ekf"].runs == 4
    assert summary.precision is not None
    assert summary.precision.unknown == (("mine", "ekf"),)
    assert "run 2: mine failed: its poses are" in str(summary_table(summary))


def test_workers_that_always_die_are_one_line_and_what_is_stored_stays(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    monkeypatch.setattr(RUN_ONCE, leave_at_once)
    line = r"^a worker process died 3 times in a row, the last time at run 3 alone .*; make room, and give the same"
    with pytest.raises(UserError, match=line), local_processes(1) as executor:
        run_study(scenario, 6, 0, ("ekf",), tmp_path, executor)
    assert load_runs(scenario, 6, 0, ("ekf",), tmp_path)["ekf"].run.tolist() == [0]


def test_a_run_that_takes_its_worker_with_it_is_named_and_the_others_go_on(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched, local_processes(1) as executor:
        patched.setattr(RUN_ONCE, leave_at_run_1)
        summary = run_study(scenario, 4, 0, ("ekf", "riekf"), tmp_path, executor)
    assert [(each.run, each.estimator) for each in summary.failures] == [(1, "ekf"), (1, "riekf")]
    assert {each.error for each in summary.failures} == {f"its worker process died (out of memory?) ({AGAIN})"}
    assert load_runs(scenario, 4, 0, ("ekf",), tmp_path)["ekf"].run.tolist() == [0, 2, 3]
    with local_processes(1) as executor:
        again = run_study(scenario, 4, 0, ("ekf", "riekf"), tmp_path, executor)
    assert (again.failures, again.estimators["ekf"].runs) == ((), 4)


def test_a_worker_that_dies_while_the_next_one_is_started_costs_its_own_run_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What the next one is to be given is closed by then."""
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


def test_a_worker_that_a_cluster_gave_up_is_lost_and_other_errors_are_not() -> None:
    from distributed.scheduler import KilledWorker

    assert lost_worker(KilledWorker("run", None, 4))  # pyright: ignore[reportArgumentType]
    assert lost_worker(BrokenExecutor())
    assert not lost_worker(ValueError())


def leave_at_once(*_: object) -> None:
    os._exit(1)


def leave_at_run_1(scenario: Scenario, seed: int, names: Sequence[str]) -> list[Outcome]:
    if seed == run_seed(0, 1):
        os._exit(1)
    return run_once(scenario, seed, names)
