"""Syntax trees of user code, which does not run."""

from __future__ import annotations

import ast
from pathlib import Path

from slamgauge.errors import UserError

LARGEST = 1_000_000  # bytes of a Python file, whose tree takes 600 times as much memory


def read_source(path: Path) -> bytes:
    """Return the content of a Python file.

    Raises:
        UserError: it is too large.
        OSError: it cannot be read.
    """
    if path.stat().st_size > LARGEST:
        raise UserError(f"{path.name}: has more than {LARGEST / 1e6:g} MB; keep data in files of their own")
    return path.read_bytes()


def parsed(source: bytes) -> ast.Module:
    """Return the syntax tree of a source; an empty one if it has none, because loading the file reports the error."""
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the last two: deep nesting
        return ast.Module([], [])
