"""Stores of other versions, damaged stores, and stores in use: which ones a study continues, which ones it refuses."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from slamgauge import __version__
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import store as study_store
from slamgauge.compare.studies.store import digest, sole_use
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.compare.studies.summary import Summary
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]


@contextmanager
def opened(folder: Path) -> Generator[sqlite3.Connection]:
    with closing(sqlite3.connect(folder / "study.sqlite")) as connection, connection:
        yield connection


def test_another_version_continues_the_study_and_another_schema_is_refused(
    run: Run, load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Version 0.3 and older wrote no number of the schema."""
    first = run(1, ("ekf",))
    with monkeypatch.context() as patched:
        patched.setattr(study_store, "__version__", "9.9.9")
        both = run(2, ("ekf",))
    assert (first.digest, both.estimators["ekf"]["runs"]) == (both.digest, 2)
    with opened(tmp_path) as connection:
        assert dict(connection.execute("SELECT key, value FROM study"))["version"] == __version__
        assert dict(connection.execute("SELECT run, version FROM outcome")) == {0: __version__, 1: "9.9.9"}
    message = (
        r"^[^\n]+ has schema \d+ \(begun by slamgauge .*\), this is schema \d+ .*; finish it with that version, or give"
    )
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


def test_a_study_continues_with_another_description(scenario: Scenario, run: Run) -> None:
    other = scenario.model_copy(update={"description": "described in other words"})
    assert digest(other, 0) == run(1, ("ekf",)).digest
    assert run(2, ("ekf",), scenario=other).estimators["ekf"]["runs"] == 2


RUNS = 6
NAMES = ("ekf", "dead-reckoning")


@pytest.fixture
def whole(run: Run, tmp_path: Path) -> Path:
    """The store of a small study, without side files."""
    run(RUNS, NAMES)
    return tmp_path / "study.sqlite"


@pytest.mark.parametrize("damage", ["cut", "zeros", "text", "names", "rows"])
def test_a_damaged_store_is_refused_in_a_line(whole: Path, run: Run, load: Load, damage: str) -> None:
    good = whole.read_bytes()
    if damage == "cut":
        whole.write_bytes(good[: len(good) // 2])
    elif damage == "zeros":
        whole.write_bytes(bytes(4096) + good[4096:])
    elif damage == "text":
        whole.write_text("not a database, but long enough to be read as one " * 50)
    elif damage == "names":  # bytes that are no text, in a message of SQLite
        whole.write_bytes(good.replace(b"study", b"stud\xff").replace(b"CREATE TABLE", b"CREATE TABLX"))
    else:
        with opened(whole.parent) as connection:
            connection.execute("UPDATE outcome SET series = substr(series, 2) WHERE run = 3")
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
