"""Folders for unfinished results, and the locks of commands that write to the same place.

A lock ends with its process. A partial folder with a free lock was left by a killed command and is removed.
"""

from __future__ import annotations

import shutil
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from filelock import FileLock, Timeout

from slamgauge.errors import UserError

MARK = "mark"  # proof that slamgauge made the folder
OWNER = "owner"  # locked while a command works in the folder
FILES = "files"
PUBLISHING = ".slamgauge.lock"
PATIENCE = 10.0  # s; publishing takes a fraction of that


@contextmanager
def partial_folder(parent: Path) -> Generator[Path]:
    """Yield an empty folder below `parent`, on the same file system; it is removed with its contents at the end.

    Partial folders of killed commands are removed first. `parent` is created if it is missing.
    """
    parent.mkdir(parents=True, exist_ok=True)
    _remove_abandoned(parent)
    folder = parent / f".slamgauge.{token_hex(4)}.partial"
    folder.mkdir()
    try:
        with FileLock(folder / OWNER, timeout=0):
            try:
                (folder / MARK).write_bytes(_mark(folder))
                (folder / FILES).mkdir()
                yield folder / FILES
            finally:
                shutil.rmtree(folder / FILES, ignore_errors=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def publishing(folder: Path) -> Generator[None]:
    """Be the only command that moves files into `folder` or changes its manifest.

    Raises:
        UserError: another command does that and does not finish in time.
    """
    try:
        with lock_file(folder / PUBLISHING, PATIENCE):
            yield
    except Timeout:
        raise UserError(
            f"{folder}: another command has been writing there for {PATIENCE:g} s; wait for it, "
            "and give the same command again"
        ) from None


@contextmanager
def lock_file(path: Path, seconds: float = 0.0) -> Generator[None]:
    """Hold a lock by a file at `path`, which is removed at the end.

    Raises:
        Timeout: another process still holds it after that many seconds.
        OSError: the file cannot be written.
    """
    with FileLock(path, timeout=seconds):
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes no open file; its lock does that
                path.unlink()


def _remove_abandoned(parent: Path) -> None:
    """Remove partial folders that no command works in; folders that are not provably ours stay."""
    for folder in parent.glob(".slamgauge.*.partial"):
        with suppress(OSError, Timeout):  # foreign, in use, or being removed by another command
            mark = folder / MARK
            if folder.is_symlink() or mark.is_symlink() or not mark.is_file() or mark.read_bytes() != _mark(folder):
                continue
            with FileLock(folder / OWNER, timeout=0):
                shutil.rmtree(folder / FILES, ignore_errors=True)
            shutil.rmtree(folder, ignore_errors=True)


def _mark(folder: Path) -> bytes:
    """Return content that no folder of another name or place has: a copy has another inode."""
    return f"{folder.name} {folder.stat().st_ino}\n".encode()
