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
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.catalogue import STORED
from slamgauge.compare.scoring.runs import SERIES, Runs
from slamgauge.compare.storage.files import explained
from slamgauge.compare.studies.store_file import INSERT, SCHEMA, TABLES, connected
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS
from slamgauge.version import __version__

BUSY = 10  # s to wait for another program before a run cannot be stored
_DONE = "estimator = ?1 AND run < ?2 AND error IS NULL"
_OF_ONE_KIND = f"{_DONE} AND (SELECT count(DISTINCT kind) FROM outcome WHERE {_DONE}) = 1"


def digest(scenario: Scenario, seed: int) -> str:
    """Return the SHA-256 of a scenario and a seed: equal digests, equal measurements."""
    return hashlib.sha256(f"{_relevant(scenario).model_dump_json()} seed {seed}".encode()).hexdigest()


def _relevant(scenario: Scenario) -> Scenario:
    """Return the scenario without description, and with the default `fis` where a sensor with ranges ignores it."""
    fis = type(scenario.fis)() if SENSORS[scenario.sensor.kind].places_landmarks else scenario.fis
    return scenario.model_copy(update={"description": "", "fis": fis})


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
        """Return run, estimator and error of each failure among the first `runs`, and changes of kind."""
        query = "SELECT run, estimator, error FROM outcome WHERE error IS NOT NULL AND run < ? ORDER BY run, estimator"
        return [*self._connection.execute(query, (runs,)), *self._changes_of_kind(runs)]

    def _changes_of_kind(self, runs: int) -> Generator[tuple[int, str, str]]:
        """Return run, estimator and message where an estimator has runs of two kinds (filtered and smoothed)."""
        query = (
            "SELECT estimator, min(run), kind FROM outcome WHERE error IS NULL AND run < ? "
            "GROUP BY estimator, kind ORDER BY estimator, min(run)"
        )
        rows = list(self._connection.execute(query, (runs,)))
        for (name, first, kind), (other, run, another) in pairwise(rows):
            if name == other:
                what = f"its poses are {kind} in run {first} and {another} in run {run}"
                yield run, name, f"{what}; none of its runs counts: return the same kind in every run"

    def load(self, estimator: str, runs: int) -> Runs:
        """Return the first `runs` runs of `estimator`; none if its estimates are not all of one kind."""
        query = f"SELECT run, kind, figures, series FROM outcome WHERE {_OF_ONE_KIND} ORDER BY run"
        rows = list(self._connection.execute(query, (estimator, runs)))
        try:
            figures = [json.loads(text) for _, _, text, _ in rows]
            series = np.array([np.frombuffer(blob, dtype=np.float32) for _, _, _, blob in rows], dtype=np.float64)
            series = np.moveaxis(series.reshape(len(rows), len(SERIES), -1 if rows else 0), 1, 0)
        except ValueError as error:
            raise sqlite3.DatabaseError(f"damaged rows of {estimator}: {error}") from None
        table = np.array([[np.nan if each.get(key) is None else each[key] for key in STORED] for each in figures])
        return Runs(
            run=np.array([run for run, _, _, _ in rows], dtype=np.int64),
            kind=rows[0][1] if rows else "",
            figures=dict(zip(STORED, table.reshape(len(rows), len(STORED)).T, strict=True)),
            series=dict(zip(SERIES, series, strict=True)),
        )


def begin_store(path: Path, scenario: Scenario, seed: int) -> None:
    """Make the file at `path`, which is empty or a store, the store of this study.

    Raises:
        UserError: the file cannot be used.
    """
    ours = {
        "schema": str(SCHEMA),
        "version": __version__,  # for information only, as that of each row
        "digest": digest(scenario, seed),
        "scenario": scenario.model_dump_json(),
        "seed": str(seed),
    }
    with explained(path, "written"):
        path.touch()
    with connected(path) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.executescript(TABLES)
        with connection:
            connection.execute("BEGIN IMMEDIATE")  # another process may do the same at the same time
            found = dict(connection.execute("SELECT key, value FROM study"))
            if not found:
                connection.executemany("INSERT INTO study VALUES (?, ?)", ours.items())
                return
            _require_schema(found, path)
            if _difference(found, scenario, seed) is None:  # a version with new keys has other digests
                connection.execute("UPDATE study SET value = ? WHERE key = 'digest'", (ours["digest"],))


def _difference(found: dict[str, str], scenario: Scenario, seed: int) -> str | None:
    """Return what differs in a store with these entries, `scenario` or `seed`; None if it is of the same study."""
    if found.get("digest") == digest(scenario, seed):
        return None
    try:
        stored = Scenario.model_validate_json(found.get("scenario", ""))
    except ValueError:  # pydantic's ValidationError is one
        return "scenario"
    if _relevant(stored) != _relevant(scenario):
        return "scenario"
    return None if found.get("seed") == str(seed) else "seed"


@contextmanager
def open_store(path: Path, scenario: Scenario, seed: int) -> Generator[StudyStore]:
    """Open the store at `path`.

    Raises:
        UserError: the file holds another study, has another schema, or cannot be used.
    """
    with connected(path) as connection:
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA busy_timeout = {1000 * BUSY}")
        found = dict(connection.execute("SELECT key, value FROM study"))
        _require_schema(found, path)
        other = _difference(found, scenario, seed)
        if other is not None:
            digest = found["digest"][:12]
            raise UserError(f"{path}: has a study of another {other} (digest {digest}); give another --out")
        yield StudyStore(connection)


def read_store(path: Path, digest: str, labels: Sequence[str], runs: int) -> tuple[Scenario, dict[str, Runs]]:
    """Return the scenario of the study with that digest, and the first `runs` runs of each stored label.

    User code has a key for each of its versions; the version stored last is read.

    Raises:
        UserError: the store does not exist, has another study, or cannot be used.
    """
    if not path.is_file():
        raise UserError(f"{path}: does not exist; give the command of the study again")
    with connected(path) as connection:
        found = dict(connection.execute("SELECT key, value FROM study"))
        _require_schema(found, path)
        if found["digest"] != digest:
            raise UserError(f"{path}: has another study than the summary in this folder; give the command again")
        latest = "SELECT estimator FROM outcome GROUP BY estimator ORDER BY max(rowid)"
        keys = {_label_of(key, labels): key for (key,) in connection.execute(latest)}
        store, scenario = StudyStore(connection), Scenario.model_validate_json(found["scenario"])
        return scenario, {label: store.load(keys[label], runs) for label in labels if label in keys}


def _label_of(key: str, labels: Sequence[str]) -> str:
    """Return the longest label with which a key begins (`Asked.key`): labels may contain spaces."""
    return max((label for label in labels if f"{key} ".startswith(f"{label} ")), key=len, default="")


def _require_schema(found: dict[str, str], path: Path) -> None:
    """Refuse a store whose results may differ from those of this version."""
    if not {"schema", "version", "digest", "scenario"} <= found.keys():
        raise UserError(f"{path}: has no study; give another --out")
    schema = found["schema"]
    if schema != str(SCHEMA):
        raise UserError(
            f"{path}: has schema {schema} (begun by slamgauge {found['version']}), this is schema {SCHEMA} "
            f"(slamgauge {__version__}); finish it with that version, or give another --out"
        )
