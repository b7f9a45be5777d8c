"""Memory that a piece of work needs, held against what is free before the work begins."""

from __future__ import annotations

import ctypes
import gc
import math
import os
from contextlib import suppress
from pathlib import Path

from slamgauge.errors import UserError

GIGABYTE = 1e9
FREE_IN_PROC = Path("/proc/meminfo")  # Linux; elsewhere all of the machine's memory counts as free


def require_memory(needed: float, what: str, remedy: str) -> None:
    """Refuse work that does not fit.

    Args:
        needed: bytes.
        what: that needs them.
        remedy: what to do instead.

    Raises:
        UserError: less is free.
    """
    free = free_memory()
    if needed > free:
        raise UserError(
            f"{what} needs {needed / GIGABYTE:.1f} GB of memory, and {free / GIGABYTE:.1f} GB are free; {remedy}"
        )


def free_memory() -> float:
    """Bytes that are free on this machine, or all that limits allow this process if that is less, as far as is told."""
    return min(_available(), _limit())


def give_back() -> None:
    """Give what is free of this process's memory back to the system, before more is taken.

    Figures refer to themselves in circles, which Python looks for now and then only, and glibc keeps freed arrays of up
    to 32 MB for itself: together that is a third of what a run of a million steps takes.
    """
    gc.collect()
    with suppress(AttributeError, TypeError):  # other C libraries have no such function, or cannot be asked
        ctypes.CDLL(None).malloc_trim(0)


def _available() -> float:
    """Bytes that are free on this machine, all that it has where it does not say; infinite where it says nothing."""
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


def _limit() -> float:
    """Bytes that limits allow this process (`ulimit -d`, `ulimit -v`); infinite without."""
    try:
        import resource
    except ImportError:  # Windows has none
        return math.inf
    limits = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA))
    return min((float(limit) for limit in limits if limit != resource.RLIM_INFINITY), default=math.inf)
