"""Notices on standard error, printed once per process."""

from __future__ import annotations

import sys
from functools import cache


@cache
def tell_once(notice: str) -> None:
    """Print a line on standard error, the first time in this process."""
    print(f"slamgauge: {notice}", file=sys.stderr)
