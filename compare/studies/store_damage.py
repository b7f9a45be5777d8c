"""Damage of a store: bits that have flipped and ends that are cut off are found, and cost the runs that they hit.

Every row carries a checksum of all that it says, and SQLite checks the structure of the file around the rows. What is
whole is kept in a new file that takes the old one's place; a study then carries out again what lacks.
"""

from __future__ import annotations

import hashlib
import sqlite3
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.partial_folder import partial_folder
from slamgauge.compare.storage.result_files import SQLITE_SIDE_FILES
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.studies.store_file import connected, words_of
from slamgauge.errors import UserError

COLUMNS = "run, estimator, seed, kind, error, figures, series"
TABLES = """
BEGIN;
CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS outcome (
    run INTEGER NOT NULL,
    estimator TEXT NOT NULL,
    seed INTEGER NOT NULL,
    kind TEXT NOT NULL,
    error TEXT,
    figures TEXT NOT NULL,
    series BLOB NOT NULL,
    checksum TEXT,
    PRIMARY KEY (run, estimator)
);
COMMIT;
"""
INSERT = "INSERT OR IGNORE INTO outcome VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
NAMED = 5  # runs that lack; of others their number is told
MOST_LOST = 10_000  # places in a row where no row can be read: nothing is behind them

Row = Sequence[Any]  # of COLUMNS


def with_checksum(row: Row) -> tuple[Any, ...]:
    """A row and the SHA-256 of all that it says."""
    *head, series = row
    content = repr(head).encode() + (series if isinstance(series, bytes) else repr(series).encode())
    return (*row, hashlib.sha256(content).hexdigest())


def add_checksums(connection: sqlite3.Connection) -> None:
    """Give the rows of a store their checksums, if it was begun before there were any."""
    if not _lacks_checksums(connection):
        return
    with connection:
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("ALTER TABLE outcome ADD COLUMN checksum TEXT")
        for row in connection.execute(f"SELECT {COLUMNS} FROM outcome").fetchall():
            update = "UPDATE outcome SET checksum = ? WHERE run = ? AND estimator = ?"
            connection.execute(update, (with_checksum(row)[-1], row[0], row[1]))


def require_whole(path: Path) -> None:
    """Refuse a damaged store.

    Raises:
        UserError: what is wrong with it, and who mends it.
    """
    damage = _damage(path)
    if damage:
        raise UserError(f"{path}: is damaged ({damage}); the command that made it mends it, and runs again what lacks")


def mend_store(path: Path) -> None:
    """Replace a damaged store by what of it is whole, and tell which runs lack now; one that is whole stays as it is.

    Raises:
        UserError: nothing can be kept.
    """
    damage = _damage(path)
    if not damage:
        return
    kept: list[tuple[int, str]] = []
    with explained(path, "written"), partial_folder(path.parent) as stage:
        with closing(sqlite3.connect(stage / path.name)) as new, connected(path) as old:
            new.executescript(TABLES)
            with new:
                new.executemany("INSERT INTO study VALUES (?, ?)", _about(path, old, damage))
                for row in _whole_rows(old):
                    new.execute(INSERT, row)
                    kept.append((row[0], row[1]))
        for ending in SQLITE_SIDE_FILES:  # they belong to the old one
            path.with_name(f"{path.name}{ending}").unlink(missing_ok=True)
        (stage / path.name).replace(path)
    told = f"{len(kept)} rows are whole and stay, what lacks is carried out again{_lacking(kept)}"
    print(f"slamgauge: {path}: was damaged ({damage}): {told}", file=sys.stderr)


def _damage(path: Path) -> str:
    """What is wrong with a store; nothing if it is whole, or not begun."""
    if not path.stat().st_size:
        return ""
    with connected(path) as connection:
        try:
            answer = connection.execute("PRAGMA integrity_check(1)").fetchone()[0]
            if answer != "ok":
                return " ".join(str(answer).split())
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"study", "outcome"} <= tables:
                return "its tables are not there" if tables else ""
            columns = ", ".join(_columns(connection))
            if columns == COLUMNS:  # begun before there were checksums
                return ""
            if columns != f"{COLUMNS}, checksum":
                return "the columns of its tables are not what they were"
            found = next((row for row in readable_rows(connection) if row != with_checksum(row[:-1])), None)
        except sqlite3.DatabaseError as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise
            return words_of(error)
    return "" if found is None else f"run {found[0]} of {shown(str(found[1]))} is not what its checksum says"


def _about(path: Path, connection: sqlite3.Connection, damage: str) -> list[Row]:
    """What a damaged store says of itself; `UserError` if it cannot, or if nobody knows which of its rows are whole."""
    with suppress(sqlite3.DatabaseError):
        about = connection.execute("SELECT key, value FROM study").fetchall()
        if about and not _lacks_checksums(connection):
            return about
    raise UserError(f"{path}: is damaged ({damage}), and cannot be mended; move it away or give another --out")


def _whole_rows(connection: sqlite3.Connection) -> Generator[tuple[Any, ...]]:
    return (row for row in readable_rows(connection) if row == with_checksum(row[:-1]))


def readable_rows(connection: sqlite3.Connection) -> Generator[tuple[Any, ...]]:
    """All rows, with their checksums, without those on pages that cannot be read."""
    connection.text_factory = _decoded
    query = f"SELECT rowid, {COLUMNS}, checksum FROM outcome NOT INDEXED WHERE rowid > ? ORDER BY rowid"
    place, lost = 0, 0
    while lost < MOST_LOST:
        try:
            for number, *row in connection.execute(query, (place,)):
                if number <= place:  # a page in the place of another leads back to where we have been
                    break
                place, lost = number, 0
                yield tuple(row)
            else:
                return
        except sqlite3.DatabaseError:
            pass
        place, lost = place + 1, lost + 1


def _decoded(text: bytes) -> str:
    """Whatever has become of a text."""
    return text.decode("utf-8", "surrogateescape")


def _lacks_checksums(connection: sqlite3.Connection) -> bool:
    return "checksum" not in _columns(connection)


def _columns(connection: sqlite3.Connection) -> list[str]:
    """Names of what a row has."""
    return [column[1] for column in connection.execute("PRAGMA table_info(outcome)")]


def _lacking(kept: Iterable[tuple[int, str]]) -> str:
    """Which runs lack among those that are there, by estimator."""
    there = {*kept}
    names, runs = {name for _, name in there}, range(max((run for run, _ in there), default=-1) + 1)
    lacking = sorted({(run, name) for run in runs for name in names} - there)
    named = [f"run {run} of {shown(name)}" for run, name in lacking[:NAMED]]
    more = [f"{len(lacking) - NAMED} more"] if len(lacking) > NAMED else []
    return f": {', '.join(named + more)}" if named else ""
