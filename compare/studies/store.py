"""The store of a study: one SQLite file with a row per run and estimator, written as results arrive.

Every run is one transaction of a write-ahead log: a run is stored completely or not at all, however the process ends,
and the next process continues with the missing runs. A failure of the machine (`Outcome.transient`) is not stored, so
that the next process tries that run again.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.catalogue import STORED
from slamgauge.compare.scoring.runs import SERIES, Runs
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import LOCK, shown
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.errors import UserError
from slamgauge.version import __version__

# Raise it when `TABLES` or `SERIES` change, when the same scenario and seed give other measurements or an estimator of
# slamgauge other results, when a figure gets another meaning, or when scenarios lose a key: stores of another schema
# are refused. A new figure needs no new number: it is NaN in old rows.
SCHEMA = 4
TABLES = """
CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS outcome (
    run INTEGER NOT NULL,
    estimator TEXT NOT NULL,
    version TEXT NOT NULL,
    seed INTEGER NOT NULL,
    kind TEXT NOT NULL,
    error TEXT,
    figures TEXT NOT NULL,
    series BLOB NOT NULL,
    PRIMARY KEY (run, estimator)
);
"""
INSERT = "INSERT OR IGNORE INTO outcome VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
MIXED = (
    "its poses are filtered in some runs and smoothed in others; none of its runs counts: return the same kind in all"
)
PATIENCE, BUSY = 1.0, 10.0  # s to wait for another program: to begin, and to store a run
# errors of SQLite that are not the file's fault: the same command may succeed later
_IN_USE = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_REFUSALS = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_READONLY)


def digest(scenario: Scenario, seed: int) -> str:
    """Return the SHA-256 of a scenario without its description and a seed: equal digests, equal measurements."""
    relevant = scenario.model_copy(update={"description": ""})
    return hashlib.sha256(f"{relevant.model_dump_json()} seed {seed}".encode()).hexdigest()


class StudyStore:
    """An open store; see `open_store`."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def stored(self) -> set[tuple[int, str]]:
        """Return run and estimator of every row."""
        return set(self._connection.execute("SELECT run, estimator FROM outcome"))

    def add(self, run: int, seed: int, outcomes: Sequence[Outcome]) -> None:
        """Store the outcomes of a run, without transient failures; existing rows do not change."""
        rows = [
            (run, each.estimator, __version__, seed, each.kind, each.error, json.dumps(each.figures), each.series)
            for each in outcomes
            if not each.transient
        ]
        with self._connection:
            self._connection.executemany(INSERT, rows)

    def failures(self, runs: int) -> list[tuple[int, str, str]]:
        """Return run, estimator and error of each failure among the first `runs`, and of mixed kinds."""
        failed = "SELECT run, estimator, error FROM outcome WHERE error IS NOT NULL AND run < ? ORDER BY run, estimator"
        mixed = (
            "SELECT min(run), estimator, ? FROM outcome WHERE error IS NULL AND run < ? "
            "GROUP BY estimator HAVING count(DISTINCT kind) > 1"
        )
        failures = list(self._connection.execute(failed, (runs,)))
        failures.extend(self._connection.execute(mixed, (MIXED, runs)))
        return failures

    def load(self, estimator: str, runs: int) -> Runs:
        """Return the first `runs` runs of `estimator`; none if its estimates are not all of one kind."""
        query = (
            "SELECT run, kind, figures, series FROM outcome "
            "WHERE estimator = ? AND run < ? AND error IS NULL ORDER BY run"
        )
        rows = list(self._connection.execute(query, (estimator, runs)))
        kinds = {kind for _, kind, _, _ in rows}
        rows = rows if len(kinds) == 1 else []
        try:
            figures = [json.loads(text) for _, _, text, _ in rows]
            stored = [np.frombuffer(blob, dtype=np.float32) for _, _, _, blob in rows]
            series = np.array(stored, dtype=np.float64).reshape(len(rows), len(SERIES), -1 if rows else 0)
        except ValueError as error:
            raise sqlite3.DatabaseError(f"damaged rows of {estimator}: {error}") from None
        table = np.array([[each.get(key) for key in STORED] for each in figures], dtype=np.float64)  # None becomes NaN
        return Runs(
            run=np.array([run for run, _, _, _ in rows], dtype=np.int64),
            kind=kinds.pop() if rows else "",
            figures=dict(zip(STORED, table.reshape(len(rows), len(STORED)).T, strict=True)),
            series=dict(zip(SERIES, series.swapaxes(0, 1), strict=True)),
        )


@contextmanager
def open_store(path: Path, scenario: Scenario, seed: int, *, begin: bool = False) -> Generator[StudyStore]:
    """Open the store at `path`; `begin` makes it first if it does not exist.

    Raises:
        UserError: the file holds another study, has another schema, or cannot be used.
    """
    own = digest(scenario, seed)
    if begin:
        with explained(path, "written"):
            path.touch()
    with _connected(path) as connection:
        if begin:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.executescript(TABLES)
            entries = {"schema": SCHEMA, "version": __version__, "scenario": scenario.model_dump_json(), "seed": seed}
            with connection:
                connection.execute("BEGIN IMMEDIATE")  # a store in use by another program is refused at once
                if not dict(connection.execute("SELECT key, value FROM study")):
                    rows = ((key, str(each)) for key, each in entries.items())
                    connection.executemany("INSERT INTO study VALUES (?, ?)", rows)
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA busy_timeout = {round(1000 * BUSY)}")
        found, other = _about(connection, path)
        if found != own:
            what = "seed" if digest(other, seed) == own else "scenario"
            raise UserError(f"{path}: has a study of another {what} (digest {found[:12]}); give another --out")
        yield StudyStore(connection)


def read_store(path: Path, digest: str, labels: Sequence[str], runs: int) -> tuple[Scenario, dict[str, Runs]]:
    """Return the scenario of the study with that digest, and the first `runs` runs of each stored label.

    User code has a key for each of its versions; the version stored last is read.

    Raises:
        UserError: the store does not exist, has another study, or cannot be used.
    """
    if not path.is_file():
        raise UserError(f"{path}: does not exist; give the command of the study again")
    with _connected(path) as connection:
        found, scenario = _about(connection, path)
        if found != digest:
            raise UserError(f"{path}: has another study than the summary in this folder; give the command again")
        latest = "SELECT estimator FROM outcome GROUP BY estimator ORDER BY max(rowid)"
        keys: dict[str, str] = {}
        for (key,) in connection.execute(latest):  # a key begins with its label (`Asked.key`), which may contain spaces
            keys[max((each for each in labels if f"{key} ".startswith(f"{each} ")), key=len, default="")] = key
        store = StudyStore(connection)
        return scenario, {label: store.load(keys[label], runs) for label in labels if label in keys}


def _about(connection: sqlite3.Connection, path: Path) -> tuple[str, Scenario]:
    """Return digest and scenario of a store; refuse one whose results may differ from those of this version."""
    found = dict(connection.execute("SELECT key, value FROM study"))
    if not {"schema", "version", "scenario", "seed"} <= found.keys():
        raise UserError(f"{path}: has no study; give another --out")
    if found["schema"] != str(SCHEMA):
        raise UserError(
            f"{path}: has schema {found['schema']} (begun by slamgauge {found['version']}), this is schema {SCHEMA} "
            f"(slamgauge {__version__}); finish it with that version, or give another --out"
        )
    try:
        scenario = Scenario.model_validate_json(found["scenario"])
    except ValueError:  # pydantic's ValidationError is one
        raise UserError(f"{path}: has a scenario that this version cannot read; give another --out") from None
    return digest(scenario, int(found["seed"])), scenario


@contextmanager
def sole_use(path: Path) -> Generator[None]:
    """Make this command the only one that adds to the store at `path`; others may read it.

    Raises:
        UserError: another command adds to it.
    """
    file = path.with_name(f"{path.name}{LOCK}")
    lock = FileLock(file, timeout=0)
    with explained(file, "written"):
        try:
            lock.acquire()
        except Timeout:
            raise UserError(f"{path}: another command is using it; wait for it, or give another --out") from None
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
        lock.release()


@contextmanager
def _connected(path: Path) -> Generator[sqlite3.Connection]:
    """Open the existing database at `path`; errors of SQLite become a `UserError` in one line."""
    try:
        uri = f"{path.absolute().as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE)) as connection:
            yield connection
    except (sqlite3.Error, UnicodeDecodeError) as error:
        text = str(error)
        if isinstance(error, UnicodeDecodeError):  # SQLite's message quotes bytes of the file
            text = error.object.decode(errors="backslashreplace")
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the low byte is the primary code
        if code in _IN_USE:
            reason, remedy = "another program is using it", "close that, and give the same command again"
        elif code in _REFUSALS:
            reason, remedy = "cannot be written", "make room, and give the same command again"
        else:
            reason, remedy = "cannot be used as a study's store", "give another --out"
        raise UserError(f"{path}: {reason} ({shown(' '.join(text.split()))}); {remedy}") from None
