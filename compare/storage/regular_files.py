"""Bytes of regular files: pipes and devices, which may never end, are refused."""

from __future__ import annotations

import stat
from pathlib import Path

from slamgauge.errors import UserError

LARGEST = 1_000_000_000  # bytes that are read at once


def require_regular(path: Path) -> int:
    """Return the size of a file [bytes]; raise UserError if it is a pipe or a device, OSError if it does not exist."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):  # opening a folder is an OSError
        raise UserError(f"{path}: is not a regular file; copy its content to one")
    return status.st_size


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file of at most `LARGEST` bytes.

    Raises:
        UserError: it is larger, or not a regular file.
        OSError: the system cannot read it.
    """
    if require_regular(path) > LARGEST:
        raise UserError(f"{path}: is larger than {LARGEST / 1e9:g} GB; give a part of it")
    return path.read_bytes()
