"""Processor time of user code."""

from __future__ import annotations

import os
from time import thread_time

try:
    import resource
except ImportError:  # Windows
    resource = None


def cpu_seconds() -> float:
    """Return the processor time of this thread and of finished child processes [s].

    Other threads do not count. Without `resource` the time of child processes is rounded to clock ticks; Windows does
    not measure it.
    """
    if resource is None:
        times = os.times()
        return thread_time() + times.children_user + times.children_system
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return thread_time() + usage.ru_utime + usage.ru_stime
