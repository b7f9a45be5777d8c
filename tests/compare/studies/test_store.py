"""Stores of other versions, damaged or in use, and which failures of runs a store keeps."""

from __future__ import annotations

import json
import os
import re
import sqlite3
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from slamgauge import __version__
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import store as study_store
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.store import MIXED, sole_use
from slamgauge.compare.studies.study import AGAIN
from slamgauge.compare.studies.study_run import Outcome, run_once, run_seed
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]


@contextmanager
def opened(folder: Path) -> Generator[sqlite3.Connection]:
    with closing(sqlite3.connect(folder / "study.sqlite")) as connection, connection:
        yield connection


def test_another_version_continues_the_study_and_another_schema_is_refused(
    scenario: Scenario, run: Run, load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another description does not matter either. Version 0.3 and older wrote no number of the schema."""
    first = run(1, ("ekf",))
    with monkeypatch.context() as patched:
        patched.setattr(study_store, "__version__", "9.9.9")
        both = run(2, ("ekf",), scenario=scenario.model_copy(update={"description": "other words"}))
    assert (first.digest, both.estimators["ekf"]["runs"]) == (both.digest, 2)
    with opened(tmp_path) as connection:
        assert dict(connection.execute("SELECT key, value FROM study"))["version"] == __version__
        assert dict(connection.execute("SELECT run, version FROM outcome")) == {0: __version__, 1: "9.9.9"}
    message = r"^[^\n]+ has schema \d+ \(begun by slamgauge .*\), this is schema \d+ .*; finish it with that version"
    with monkeypatch.context() as patched, pytest.raises(UserError, match=message):
        patched.setattr(study_store, "SCHEMA", study_store.SCHEMA + 1)
        run(1, ("ekf",))
    with opened(tmp_path) as connection:
        connection.execute("DELETE FROM study WHERE key = 'schema'")
    for again in (run, load):
        with pytest.raises(UserError, match=r"^[^\n]+study.sqlite: has no study; give another --out$"):
            again(2, ("ekf",))


def test_figures_that_old_rows_lack_are_unknown(run: Run, load: Load, tmp_path: Path) -> None:
    """A study from before these figures existed continues, and its old runs are not repeated."""
    run(2, ("causal",))
    with opened(tmp_path) as connection:
        (text,) = connection.execute("SELECT figures FROM outcome").fetchone()
        old = {key: figure for key, figure in json.loads(text).items() if key != "optimum_check_sigma"}
        for number, figures in enumerate((old, {**old, "optimum_check_sigma": np.inf})):
            connection.execute("UPDATE outcome SET figures = ? WHERE run = ?", (json.dumps(figures), number))
    np.testing.assert_array_equal(load(2, ("causal",))["causal"].figures["optimum_check_sigma"], [np.nan, np.inf])
    entry = run(2, ("causal",)).estimators["causal"].to_json()
    assert entry["optimum_check_share"] == 1.0
    json.dumps(entry, allow_nan=False)


def test_a_full_disk_does_not_damage_the_store(scenario: Scenario, run: Run, tmp_path: Path) -> None:
    run(1, ("ekf",))
    with (
        pytest.raises(UserError, match=r"cannot be written \(.*full\); make room, and give the same command again"),
        study_store.open_store(tmp_path / "study.sqlite", scenario, 0) as store,
    ):
        store._connection.execute("PRAGMA max_page_count = 1")
        store.add(1, 0, [Outcome("ekf", series=bytes(1_000_000))])
    assert run(2, ("ekf",)).estimators["ekf"]["runs"] == 2


RUNS = 6
NAMES = ("ekf", "dead-reckoning")


@pytest.fixture
def whole(run: Run, tmp_path: Path) -> Path:
    """The store of a small study, without side files."""
    run(RUNS, NAMES)
    return tmp_path / "study.sqlite"


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda good: good[: len(good) // 2],
    "zeros": lambda good: bytes(4096) + good[4096:],
    "names": lambda good: good.replace(b"study", b"stud\xff").replace(b"CREATE TABLE", b"CREATE TABLX"),
}


@pytest.mark.parametrize("damage", ["rows", *DAMAGES])
def test_a_damaged_store_is_refused_in_a_line(whole: Path, run: Run, load: Load, damage: str) -> None:
    """Damaged names are not text, and SQLite prints them in its message."""
    if damage == "rows":
        with opened(whole.parent) as connection:
            connection.execute("UPDATE outcome SET series = substr(series, 2) WHERE run = 3")
    else:
        whole.write_bytes(DAMAGES[damage](whole.read_bytes()))
    for use in (load, run):
        with pytest.raises(
            UserError, match=rf"^{whole}: cannot be used as a study's store [^\n]+; give another --out$"
        ):
            use(RUNS, NAMES)


def test_a_store_in_use_is_refused_at_once(run: Run, whole: Path) -> None:
    line = rf"^{whole}: another command is using it; wait for it, or give another"
    with sole_use(whole), pytest.raises(UserError, match=line):
        run(RUNS, NAMES)
    assert not whole.with_name("study.sqlite-lock").exists()
    line = rf"^{whole}: another program is using it .*; close that, and give the"
    with closing(sqlite3.connect(whole)) as other, pytest.raises(UserError, match=line):
        other.execute("BEGIN EXCLUSIVE")
        run(RUNS, NAMES)
    run(RUNS, NAMES)


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


@pytest.mark.parametrize("place", ["slamgauge.ekf.riekf", "slamgauge.compare.studies.study_run.simulate_informed"])
def test_a_failure_of_the_machine_is_reported_and_the_same_command_repeats_the_run(
    run: Run, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """What did not fail is stored."""
    with monkeypatch.context() as patched:
        patched.setattr(place, Mock(side_effect=MemoryError("too large")))
        summary = run(1, BOTH)
    line = f"MemoryError: too large ({AGAIN})"
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
    assert (failure.run, failure.estimator, failure.error) == (0, "mine", MIXED)
    assert (summary.estimators["mine"]["kind"], summary.estimators["mine"]["runs"]) == (None, 0)
    assert len(load(4, chosen)["mine"].run) == 0
    assert summary.against == {"ekf": {"mine": {}}}
    assert "run 0: mine failed: its poses are" in str(summary_table(summary))


def test_workers_that_always_die_are_one_line_and_stored_runs_are_kept(
    run: Run, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(1, ("ekf",))
    monkeypatch.setattr("slamgauge.compare.studies.study.run_once", leave_at_once)
    line = (
        r"^3 worker processes died one after another, the last one at run 3 \(.*; make room or give fewer --jobs, and"
    )
    with pytest.raises(UserError, match=line), local_processes(1) as executor:
        run(6, ("ekf",), executor=executor)
    assert load(6, ("ekf",))["ekf"].run.tolist() == [0]


def test_a_run_that_kills_its_worker_is_named_and_the_others_continue(
    run: Run, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched, local_processes(1) as executor:
        patched.setattr("slamgauge.compare.studies.study.run_once", leave_at_run_1)
        summary = run(4, BOTH, executor=executor)
    assert [(each.run, each.estimator) for each in summary.failures] == [(1, "ekf"), (1, "riekf")]
    assert {each.error for each in summary.failures} == {f"its worker process died (out of memory?) ({AGAIN})"}
    assert load(4, ("ekf",))["ekf"].run.tolist() == [0, 2, 3]
    again = run(4, BOTH)
    assert (again.failures, again.estimators["ekf"]["runs"]) == ((), 4)


def leave_at_once(*_: object) -> None:
    os._exit(1)


def leave_at_run_1(scenario: Scenario, seed: int, names: Sequence[str]) -> list[Outcome]:
    if seed == run_seed(0, 1):
        os._exit(1)
    return run_once(scenario, seed, names)
