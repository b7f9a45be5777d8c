"""Check of free memory before work begins."""

from __future__ import annotations

import math
from pathlib import Path

from slamgauge.errors import UserError

GIGABYTE = 1e9
FREE_IN_PROC = Path("/proc/meminfo")  # Linux; on other systems nothing is refused


def require_memory(needed: float, what: str, remedy: str) -> None:
    """Raise `UserError` if work, named `what`, needs more than the free memory [bytes]; `remedy` ends its text."""
    free = free_memory()
    if needed > free:
        raise UserError(
            f"{what} needs {needed / GIGABYTE:.1f} GB of memory, and {free / GIGABYTE:.1f} GB are free; {remedy}"
        )


def free_memory() -> float:
    """Return the free bytes of this machine; infinity if they are not known."""
    try:
        sizes = dict(line.split(":", 1) for line in FREE_IN_PROC.read_text(encoding="ascii").splitlines())
        return 1024.0 * int(sizes["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return math.inf
