"""Check of free memory before work begins."""

from __future__ import annotations

import math
import os
from pathlib import Path

from slamgauge.errors import UserError

GIGABYTE = 1e9
FREE_IN_PROC = Path("/proc/meminfo")  # Linux; on other systems all memory counts as free


def require_memory(needed: float, what: str, remedy: str) -> None:
    """Refuse work that needs more than the free memory.

    Args:
        needed: bytes.
        what: name of the work, for the error text.
        remedy: end of the error text.

    Raises:
        UserError: fewer bytes are free.
    """
    free = free_memory()
    if needed > free:
        raise UserError(
            f"{what} needs {needed / GIGABYTE:.1f} GB of memory, and {free / GIGABYTE:.1f} GB are free; {remedy}"
        )


def free_memory() -> float:
    """Return the free bytes of this machine, else all its bytes, else infinity."""
    try:
        lines = FREE_IN_PROC.read_text(encoding="ascii").splitlines()
        sizes = dict(line.split(":", 1) for line in lines)
        return 1024.0 * int(sizes["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # Windows has no sysconf
        return math.inf
