"""The SQLite file of a study: tables, locking, and errors of SQLite in one line."""

from __future__ import annotations

import sqlite3
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import LOCK
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError

# Raise it when `TABLES` or `SERIES` change, when the same scenario and seed give other measurements or an estimator of
# slamgauge other results, when a figure gets another meaning, or when scenarios lose a key: stores of another schema
# are refused. A new figure needs no new number: it is NaN in old rows.
SCHEMA = 4
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
    PRIMARY KEY (run, estimator)
);
COMMIT;
"""
INSERT = "INSERT OR IGNORE INTO outcome VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
PATIENCE = 1.0  # s to wait for another program that uses the store
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
