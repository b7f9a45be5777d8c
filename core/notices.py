"""Notices on standard error, printed once per process."""

from __future__ import annotations

import sys
from functools import cache


def tell_first(topic: str, notice: str) -> None:
    """Print the first notice about a topic in this process on standard error."""
    if not (heard := _heard(topic)):
        heard.append(notice)
        tell_once(notice)


@cache
def tell_once(notice: str) -> None:
    """Print a line on standard error, the first time in this process."""
    print(f"slamgauge: {notice}", file=sys.stderr)


@cache
def _heard(_topic: str) -> list[str]:
    """Return the list of notices about a topic."""
    return []
