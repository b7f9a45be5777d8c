"""Check of free memory before work begins."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import sys
from contextlib import suppress
from pathlib import Path

from slamgauge.errors import UserError

try:
    import resource
except ImportError:  # Windows has no such module
    resource = None

GIGABYTE = 1e9
SMALL = 1e9  # bytes
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
    """Return the free bytes of this machine, or the process's limit if that is smaller; infinite if unknown."""
    return min(_available(), _limit())


def give_back() -> None:
    """Return this process's unused memory to the system if it has used more than `SMALL`.

    Figures are reference cycles, which Python collects rarely, and glibc keeps freed arrays of up to 32 MB. Together
    these are a third of the memory of a run of a million steps. In a small process the collection costs more than it
    frees.
    """
    if _most_used() < SMALL:
        return
    gc.collect()
    with suppress(AttributeError, TypeError):  # other C libraries have no such function
        ctypes.CDLL(None).malloc_trim(0)


def _available() -> float:
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


def _most_used() -> float:
    """Return the largest memory of this process so far in bytes; infinite if unknown."""
    if resource is None:
        return math.inf
    unit = 1 if sys.platform == "darwin" else 1024
    return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def _limit() -> float:
    """Return the limit of this process in bytes (`ulimit -d`, `ulimit -v`); infinite without a limit."""
    if resource is None:
        return math.inf
    limits = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA))
    return min((float(limit) for limit in limits if limit != resource.RLIM_INFINITY), default=math.inf)
