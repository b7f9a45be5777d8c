"""Detection of damage in a store: flipped bits and missing ends of the file.

Every row has a checksum of its content, and SQLite checks the structure of the file around the rows. The checksums are
needed: of 104 single flipped bits that damaged a store, SQLite's own check finds 6.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.studies.store_file import connected, sqlite_message
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
NAMED = 5  # damaged rows that the error message names; of more rows it gives the number
REMEDY = "move it away or give another --out, and run the study again"


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
        raise UserError(f"{path}: is damaged ({damage}); {REMEDY}")


def _decoded(text: bytes) -> str:
    return text.decode("utf-8", "surrogateescape")  # damaged text must not raise


def _damage(path: Path) -> str:
    """Describe the damage of a store; return an empty text if it has none."""
    with connected(path) as connection:
        connection.text_factory = _decoded
        try:
            answer = str(connection.execute("PRAGMA integrity_check(1)").fetchone()[0])
            if answer != "ok":
                return shown(" ".join(answer.split()))
            columns = ", ".join(column[1] for column in connection.execute("PRAGMA table_info(outcome)"))
            if columns in {"", COLUMNS}:  # not begun, or by version 0.3, which has no checksums: see `store`
                return ""
            if columns != f"{COLUMNS}, checksum":
                return "the table outcome has other columns"
            rows = connection.execute(f"SELECT {COLUMNS}, checksum FROM outcome")
            damaged = [row[:2] for row in rows if row != with_checksum(row[:-1])]
        except sqlite3.DatabaseError as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise
            return sqlite_message(error)
    named = [f"run {run} of {shown(str(name))}" for run, name in damaged[:NAMED]]
    named += [f"{len(damaged) - NAMED} more"] if len(damaged) > NAMED else []
    return f"checksums do not match: {', '.join(named)}" if damaged else ""
