"""Folders for what is half done, and locks by which commands that write into the same place tell of each other.

Whatever ends a process, its locks end with it: a partial folder whose lock is free was left by a killed command.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from slamgauge.errors import UserError

OWNER = "owner"  # beside the files: says that the folder is ours, and is locked as long as somebody works in it
FILES = "files"
PATIENCE = 10.0  # s; files are put in place in a fraction of that


@contextmanager
def partial_folder(parent: Path) -> Generator[Path]:
    """An empty folder below `parent`, on the same file system, which goes with all that is left in it.

    Those that killed commands have left there are swept first. `parent` is made if it is not there.
    """
    parent.mkdir(parents=True, exist_ok=True)
    _sweep(parent)
    folder = parent / f".slamgauge.{token_hex(4)}.partial"
    folder.mkdir()
    owner = -1
    try:
        owner = os.open(folder / OWNER, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        lock(owner)
        os.write(owner, _mark(folder))
        (folder / FILES).mkdir()
        yield folder / FILES
    finally:
        _remove(folder)
        if owner >= 0:
            os.close(owner)


@contextmanager
def publishing(folder: Path) -> Generator[None]:
    """Be the only command that puts files into their places in `folder`, or changes its manifest.

    Raises:
        UserError: another one does that, and does not come to an end.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        begun = time.monotonic()
        while not lock(descriptor):
            if time.monotonic() - begun > PATIENCE:
                raise UserError(
                    f"{folder}: another command has been writing there for {PATIENCE:g} s; wait for it, "
                    "and give the same command again"
                )
            time.sleep(0.02)
        yield
    finally:
        os.close(descriptor)


def lock(descriptor: int) -> bool:
    """Take the lock on an open file or folder, until it is closed; False if another process has it.

    File systems that know no locks give it to everybody.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _sweep(parent: Path) -> None:
    """Remove partial folders in which nobody works any more; what is not provably ours stays."""
    for folder in parent.glob(".slamgauge.*.partial"):
        with suppress(OSError):  # not ours, or another command is sweeping, too
            owner = os.open(folder / OWNER, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                if not folder.is_symlink() and lock(owner) and os.read(owner, 100) == _mark(folder):
                    _remove(folder)
            finally:
                os.close(owner)


def _remove(folder: Path) -> None:
    """Remove a partial folder, its proof last."""
    for part in (folder / FILES, folder):
        shutil.rmtree(part, ignore_errors=True)


def _mark(folder: Path) -> bytes:
    """What no folder of another name or place would hold: a copy has another inode."""
    return f"{folder.name} {folder.stat().st_ino}\n".encode()
