"""What a library does by itself and its user should know: said once, on standard error."""

from __future__ import annotations

import sys
from functools import cache


@cache
def tell_once(notice: str) -> None:
    """Print a line on standard error, the first time in this process."""
    print(f"slamgauge: {notice}", file=sys.stderr)
