"""The store of a study: one SQLite file, a row per run and estimator, written as results arrive.

Rows carry checksums (`store_damage`), and one command at a time adds to a store (`store_file`).
Every run is one transaction of a write-ahead log: whatever ends the process, a run is stored whole or
not at all, and the next process goes on with the runs that are missing. What the machine refused (`Outcome.transient`)
is not stored, so that the next process tries it again.
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

from slamgauge import __version__
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.catalogue import LATER, STORED
from slamgauge.compare.scoring.runs import SERIES, Ates, Runs
from slamgauge.compare.studies.store_damage import (
    INSERT,
    TABLES,
    add_checksums,
    mend_store,
    require_whole,
    with_checksum,
)
from slamgauge.compare.studies.store_file import connected
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS

# of what a store holds: raise it when `TABLES` (unless `begin_store` adds what lacks), `SERIES` or `STORED` change, and
# when the same scenario and seed give other measurements or a figure another meaning; stores of another number are
# refused, whatever their version.
# A further figure that old rows may lack goes into `catalogue.LATER` instead
SCHEMA = 1
# keys that scenarios have had since version 0.4, by section; a key that is added later belongs here too
LATER_KEYS = {
    "prior": ("covariance",),
    "trajectory": ("kind",),
    "motion": ("covariances", "slip_rate", "scale_error", "turn_bias_per_metre"),
    "sensor": (
        *("sightings", "field_of_view_deg", "detection_probability"),
        *("outlier_rate", "outlier", "clutter_rate"),
    ),
    "association": ("node_limit",),
    "fis": ("lost_after",),
    "inverse_depth": ("lost_after",),
    "landmarks": ("random",),
}
# defaults that were others in version 0.3, by which studies without bearings still go by their names of then
FORMER_RAYS = {"alpha": 0.3, "beta": 2.0, "s_min": 1.0}
BUSY = 10  # s that another program may keep the store from taking in a run
LATER_SECTIONS = ("update",)  # likewise whole sections
_UNNUMBERED = {"0.3.0": "1"}  # the schema of stores that were begun before they carried its number, by version
NAMES = "2"  # of estimators: raise it when a name gets another meaning, and refuse stores that hold the old one
_RENAMED = "isam2"  # until names 2 (version 0.5) the causal optimum, since then GTSAM's ISAM2
_DONE = "estimator = ?1 AND run < ?2 AND error IS NULL"
_OF_ONE_KIND = (
    f"{_DONE} AND (SELECT count(DISTINCT kind) FROM outcome WHERE {_DONE}) = 1"  # else they have no one optimum
)


def digest(scenario: Scenario, seed: int) -> str:
    """SHA-256 of all that decides the runs: equal digests, equal measurements."""
    return hashlib.sha256(f"{_as_text(scenario)} seed {seed}".encode()).hexdigest()


def _as_text(scenario: Scenario) -> str:
    """The scenario as JSON, without later keys that have their default: a new key leaves old studies as they are."""
    if (
        SENSORS[scenario.sensor.kind].places_landmarks and scenario.fis == type(scenario.fis)()
    ):  # other members change nothing
        scenario = scenario.model_copy(update={"fis": scenario.fis.model_copy(update=FORMER_RAYS)})
    sections = {name: getattr(scenario, name) for name in LATER_KEYS}
    left_out: dict[str, set[str] | bool] = {
        name: {key for key in LATER_KEYS[name] if getattr(section, key) == type(section).model_fields[key].default}
        for name, section in sections.items()
    }
    left_out |= {
        name: True for name in LATER_SECTIONS if getattr(scenario, name) == Scenario.model_fields[name].default
    }
    return scenario.model_dump_json(exclude=left_out)  # pyright: ignore[reportArgumentType]


class StudyStore:
    """An open store; see `open_store`."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def stored(self) -> set[tuple[int, str]]:
        """Run and estimator of every row."""
        return set(self._connection.execute("SELECT run, estimator FROM outcome"))

    def add(self, run: int, seed: int, outcomes: Sequence[Outcome]) -> None:
        """Store a run whole, except for what may succeed another time; what is stored already stays."""
        rows = [
            with_checksum((run, each.estimator, seed, each.kind, each.error, json.dumps(each.figures), each.series))
            for each in outcomes
            if not each.transient
        ]
        with self._connection:
            self._connection.executemany(INSERT, rows)

    def failures(self, runs: int) -> list[tuple[int, str, str]]:
        """Run, estimator and error of each failure among the first `runs`, and changes of kind."""
        query = "SELECT run, estimator, error FROM outcome WHERE error IS NOT NULL AND run < ? ORDER BY run, estimator"
        return [*self._connection.execute(query, (runs,)), *self._changes_of_kind(runs)]

    def _changes_of_kind(self, runs: int) -> Generator[tuple[int, str, str]]:
        """The first run whose kind is another than before, its estimator, and why none of its runs counts."""
        query = (
            "SELECT estimator, min(run), kind FROM outcome WHERE error IS NULL AND run < ? "
            "GROUP BY estimator, kind ORDER BY estimator, min(run)"
        )
        rows = list(self._connection.execute(query, (runs,)))
        for (name, first, kind), (other, run, another) in pairwise(rows):
            if name == other:
                what = f"its poses are {kind} in run {first} and {another} in run {run}, and no optimum is that of both"
                yield run, name, f"{what}; none of its runs counts: say the same kind of all"

    def ates(self, estimator: str, runs: int) -> Ates:
        """Of the first `runs` runs of `estimator` the ATE alone, which takes no room."""
        query = f"SELECT run, figures FROM outcome WHERE {_OF_ONE_KIND} ORDER BY run"
        rows = [(run, json.loads(text)["ate_m"]) for run, text in self._connection.execute(query, (estimator, runs))]
        ates = np.array([ate for _, ate in rows], dtype=np.float64)
        return Ates(np.array([run for run, _ in rows], dtype=np.int64), ates)

    def load(self, estimator: str, runs: int) -> Runs:
        """What the first `runs` runs gave for `estimator`; nothing if its estimates are not all of one kind."""
        query = f"SELECT run, kind, figures, series FROM outcome WHERE {_OF_ONE_KIND} ORDER BY run"
        rows = list(self._connection.execute(query, (estimator, runs)))
        figures = [dict.fromkeys(LATER) | json.loads(text) for _, _, text, _ in rows]
        table = np.array([[np.nan if each[key] is None else each[key] for key in STORED] for each in figures])
        series = np.array([np.frombuffer(blob, dtype=np.float32) for _, _, _, blob in rows], dtype=np.float64)
        return Runs(
            run=np.array([run for run, _, _, _ in rows], dtype=np.int64),
            kind=rows[0][1] if rows else "",
            figures=dict(zip(STORED, table.reshape(len(rows), len(STORED)).T, strict=True)),
            series=dict(zip(SERIES, np.moveaxis(series.reshape(len(rows), len(SERIES), -1), 1, 0), strict=True))
            if rows
            else dict.fromkeys(SERIES, np.zeros((0, 0))),
        )


def begin_store(path: Path, scenario: Scenario, seed: int) -> None:
    """Make the file at `path`, which is empty or a store, the store of this study, and mend it if it is damaged.

    Raises:
        UserError: the file cannot be used.
    """
    ours = {
        "schema": str(SCHEMA),
        "names": NAMES,
        "version": __version__,  # that began it: for information alone
        "digest": digest(scenario, seed),
        "scenario": _as_text(scenario),
        "seed": str(seed),
    }
    mend_store(path)
    with connected(path) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.executescript(TABLES)
        add_checksums(connection)
        with connection:
            connection.execute("BEGIN IMMEDIATE")  # another process may be about to claim it too
            if not connection.execute("SELECT 1 FROM study").fetchone():
                connection.executemany("INSERT INTO study VALUES (?, ?)", ours.items())
            for number in _UNNUMBERED.items():
                note = "INSERT OR IGNORE INTO study SELECT 'schema', ?2 FROM study WHERE key = 'version' AND value = ?1"
                connection.execute(note, number)
            if not _holds_renamed(connection):
                connection.execute("INSERT OR IGNORE INTO study VALUES ('names', ?)", (NAMES,))


@contextmanager
def open_store(path: Path, scenario: Scenario, seed: int) -> Generator[StudyStore]:
    """The store at `path`.

    Raises:
        UserError: the file holds another study, has another schema, or cannot be used.
    """
    with connected(path) as connection:
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA busy_timeout = {1000 * BUSY}")
        _require_same(connection, path, scenario, seed)
        yield StudyStore(connection)


def read_store(path: Path, digest: str, labels: Sequence[str], runs: int) -> tuple[Scenario, dict[str, Runs]]:
    """The scenario of a study with that digest, and its first `runs` runs by those of the labels that it has.

    People's own code has a key for every version of it: that which was stored last is meant.

    Raises:
        UserError: there is no such store, it is of another study, or it cannot be used.
    """
    if not path.is_file():
        raise UserError(f"{path}: is not there; give the command of the study again")
    require_whole(path)
    with connected(path) as connection:
        found = dict(connection.execute("SELECT key, value FROM study"))
        _require_present_names(connection, path)
        if found.get("digest") != digest or found.get("schema") != str(SCHEMA):
            raise UserError(f"{path}: is of another study than the summary beside it; give the command again")
        latest = "SELECT estimator FROM outcome GROUP BY estimator ORDER BY max(rowid)"
        keys = {key.partition(" ")[0]: key for (key,) in connection.execute(latest)}
        store, scenario = StudyStore(connection), Scenario.model_validate_json(found["scenario"])
        return scenario, {label: store.load(keys[label], runs) for label in labels if label in keys}


def _require_same(connection: sqlite3.Connection, path: Path, scenario: Scenario, seed: int) -> None:
    """Refuse a store that is for something else."""
    found = dict(connection.execute("SELECT key, value FROM study"))
    if not {"version", "digest", "scenario"} <= found.keys():
        raise UserError(f"{path}: holds no study; give another --out")
    schema = found.get("schema") or _UNNUMBERED.get(found["version"], "of old")
    if schema != str(SCHEMA):
        raise UserError(
            f"{path}: has schema {schema} (begun by slamgauge {found['version']}), this is schema {SCHEMA} "
            f"(slamgauge {__version__}); finish it with that version, or give another --out"
        )
    _require_present_names(connection, path)
    if found["digest"] != digest(scenario, seed):
        what = "another seed" if found["scenario"] == _as_text(scenario) else "another scenario"
        raise UserError(f"{path}: holds a study of {what} (digest {found['digest'][:12]}); give another --out")


def _holds_renamed(connection: sqlite3.Connection) -> bool:
    """Whether results stand under a name that has another meaning now."""
    if connection.execute("SELECT 1 FROM study WHERE key = 'names' AND value = ?", (NAMES,)).fetchone():
        return False
    query = "SELECT 1 FROM outcome WHERE estimator = ?1 OR estimator LIKE ?1 || '@%' LIMIT 1"
    return connection.execute(query, (_RENAMED,)).fetchone() is not None


def _require_present_names(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a store whose results stand under a name that has another meaning now."""
    if _holds_renamed(connection):
        raise UserError(
            f"{path}: was begun before slamgauge 0.5, when {_RENAMED!r} was the name of the causal optimum, "
            f"now 'causal' ({_RENAMED!r} is GTSAM's ISAM2 now); run the study again with 'causal' in another --out"
        )
