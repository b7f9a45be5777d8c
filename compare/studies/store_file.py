"""The SQLite file of a study: tables, checksums, locking, and errors of SQLite in one line.

Every row has a checksum of its content, and SQLite checks the structure of the file around the rows. The checksums are
needed: of 104 single flipped bits that damaged a store, SQLite's own check finds 6.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import LOCK
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError

# Raise it when `TABLES` or `SERIES` change, when the same scenario and seed give other measurements or an estimator of
# slamgauge other results, when a figure gets another meaning, or when scenarios lose a key: stores of another schema
# are refused. A new figure needs no new number: it is NaN in old rows.
SCHEMA = 3
COLUMNS = "run, estimator, version, seed, kind, error, figures, series"
TABLES = """
BEGIN;
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
    checksum TEXT,
    PRIMARY KEY (run, estimator)
);
COMMIT;
"""
INSERT = "INSERT OR IGNORE INTO outcome VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
PATIENCE = 1.0  # s to wait for another program that uses the store
_NAMED = 5  # damaged rows that the error message names; of more rows it gives the number
_IN_USE = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
# errors that are not the file's fault: the same command may succeed later
_REFUSALS = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_READONLY)


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
def connected(path: Path) -> Generator[sqlite3.Connection]:
    """Open the existing database at `path`.

    Raises:
        UserError: an error of SQLite, in one line.
    """
    try:
        uri = f"{path.absolute().as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE)) as connection:
            yield connection
    except sqlite3.Error as error:
        code = _primary_code(error)
        if code in _IN_USE:
            reason, remedy = "another program is using it", "close that, and give the same command again"
        elif code in _REFUSALS:
            reason, remedy = "cannot be written", "make room, and give the same command again"
        else:
            reason, remedy = "cannot be used as a study's store", "give another --out"
        raise UserError(f"{path}: {reason} ({_in_a_line(str(error))}); {remedy}") from None
    except UnicodeDecodeError as error:  # SQLite's message quotes bytes of the file
        message = _in_a_line(error.object.decode(errors="backslashreplace"))
        raise UserError(f"{path}: cannot be used as a study's store ({message}); give another --out") from None


def _primary_code(error: sqlite3.Error) -> int:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF  # the low byte


def _in_a_line(text: str) -> str:
    return shown(" ".join(text.split()))


def with_checksum(row: Sequence[Any]) -> tuple[Any, ...]:
    """Return a row of `COLUMNS` followed by the SHA-256 of its content."""
    *head, series = row
    content = repr(head).encode() + (series if isinstance(series, bytes) else repr(series).encode())
    return (*row, hashlib.sha256(content).hexdigest())


def require_whole(path: Path) -> None:
    """Refuse a damaged store; an empty file is not damaged.

    Raises:
        UserError: names the damaged rows, or what SQLite reports, and the remedy.
    """
    damage = _damage(path) if path.stat().st_size else ""
    if damage:
        remedy = "move it away or give another --out, and run the study again"
        raise UserError(f"{path}: is damaged ({damage}); {remedy}")


def _decoded(text: bytes) -> str:
    return text.decode("utf-8", "surrogateescape")  # damaged text must not raise


def _schema(connection: sqlite3.Connection) -> str:
    """Return the schema of a store; empty if it has none."""
    return next(iter(connection.execute("SELECT value FROM study WHERE key = 'schema'")), ("",))[0]


def _damage(path: Path) -> str:
    """Describe the damage of a store; return an empty text if it has none."""
    with connected(path) as connection:
        connection.text_factory = _decoded
        try:
            answer = str(connection.execute("PRAGMA integrity_check(1)").fetchone()[0])
            if answer != "ok":
                return _in_a_line(answer)
            columns = ", ".join(column[1] for column in connection.execute("PRAGMA table_info(outcome)"))
            if not columns or _schema(connection) != str(SCHEMA):  # empty, or `store` refuses it
                return ""
            if columns != f"{COLUMNS}, checksum":
                return "the table outcome has other columns"
            rows = connection.execute(f"SELECT {COLUMNS}, checksum FROM outcome")
            damaged = [row[:2] for row in rows if row != with_checksum(row[:-1])]
        except sqlite3.DatabaseError as error:
            if _primary_code(error) in _IN_USE:
                raise
            return _in_a_line(str(error))
    named = [f"run {run} of {shown(str(name))}" for run, name in damaged[:_NAMED]]
    named += [f"{len(damaged) - _NAMED} more"] if len(damaged) > _NAMED else []
    return f"checksums do not match: {', '.join(named)}" if damaged else ""
