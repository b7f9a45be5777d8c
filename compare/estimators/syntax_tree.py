"""Syntax trees of user code, which does not run."""

from __future__ import annotations

import ast


def parsed(source: bytes) -> ast.Module:
    """Return the syntax tree of a source; an empty one if it has none, because loading the file reports the error."""
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the last two: deep nesting
        return ast.Module([], [])
