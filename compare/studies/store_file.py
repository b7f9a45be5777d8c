"""The file of a store: opened for one command at a time to add to, what SQLite says of it told in one line."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.partial_folder import lock
from slamgauge.compare.storage.result_files import LOCK
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError

PATIENCE = 1.0  # s, for another program that has the store at this moment
# SQLite's errors that are not the file's fault: give the same command again
_REFUSALS = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_READONLY)


@contextmanager
def sole_use(path: Path) -> Generator[None]:
    """Be the only command that adds to the store at `path`; others may read it.

    Raises:
        UserError: another one is at work on it.
    """
    file = path.with_name(f"{path.name}{LOCK}")
    with explained(file, "written"):
        descriptor = _locked(path, file)
    try:
        yield
    finally:
        with suppress(OSError):
            file.unlink()
        os.close(descriptor)


def _locked(path: Path, file: Path) -> int:
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        if not lock(descriptor):
            os.close(descriptor)
            raise UserError(f"{path}: another command is at work on it; wait for it, or give another --out")
        with suppress(FileNotFoundError):
            if file.stat().st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        os.close(descriptor)  # who had it has removed it meanwhile


@contextmanager
def connected(path: Path) -> Generator[sqlite3.Connection]:
    """The database at `path`, which must be there.

    Raises:
        UserError: what SQLite raises.
    """
    try:
        uri = f"{path.absolute().as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE)) as connection:
            yield connection
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the low byte: the rest tells the kinds apart
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise UserError(
                f"{path}: another program is using it ({words_of(error)}); close that, and give the same command again"
            ) from None
        if code in _REFUSALS:
            raise UserError(
                f"{path}: cannot be written ({words_of(error)}); make room, and give the same command again"
            ) from None
        raise _unusable(path, words_of(error)) from None
    except UnicodeDecodeError as error:  # SQLite's own words, of bytes of the file
        raise _unusable(path, _in_a_line(error.object.decode(errors="backslashreplace"))) from None


def words_of(error: sqlite3.Error) -> str:
    """What SQLite says, in one line: it quotes the file, whatever is in there."""
    return _in_a_line(str(error))


def _in_a_line(words: str) -> str:
    return shown(" ".join(words.split()))


def _unusable(path: Path, reason: str) -> UserError:
    return UserError(f"{path}: cannot be used as a study's store ({reason}); give another --out")
