"""Progress lines on standard error while kernels are loaded from disk or compiled, if that takes long."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic

ANNOUNCE_AFTER = 1.0  # s of compilation
ANNOUNCE_LOADING_AFTER = 5.0  # s; loading kernels from disk takes less than a second on an idle machine

_loaded, _compiled = 0, 0  # kernels that this process has loaded and compiled


def note(*, compiled: bool) -> None:
    """Count a kernel that is about to be compiled, or that has been loaded."""
    global _loaded, _compiled  # one process has one compiler
    _loaded, _compiled = _loaded + (not compiled), _compiled + compiled


@contextmanager
def announced(what: str, kernels: int) -> Generator[None]:
    """Print the progress of about this many kernels on standard error if it takes long, as on first use.

    A terminal shows a running count; a file gets one line.
    """
    done = threading.Event()
    reporter = threading.Thread(target=_report, args=(what, kernels, done, _loaded, _compiled), daemon=True)
    reporter.start()
    try:
        yield
    finally:
        done.set()
        reporter.join()


def _report(what: str, kernels: int, done: threading.Event, loaded: int, compiled: int) -> None:
    began, printed, terminal = monotonic(), "", sys.stderr.isatty()
    while not done.wait(ANNOUNCE_AFTER):
        if _compiled > compiled:
            line = f"slamgauge: compiling ~{kernels} {what} on first use ..."
        elif _loaded > loaded and monotonic() - began > ANNOUNCE_LOADING_AFTER:
            line = f"slamgauge: loading {what} from disk ..."
        else:
            continue
        if terminal:
            count = _compiled - compiled or _loaded - loaded
            print(f"\r{line} {count} done, {monotonic() - began:.0f} s", end="", file=sys.stderr, flush=True)
        elif line != printed:
            print(line, file=sys.stderr)
        printed = line
    if terminal and printed:
        print(file=sys.stderr)
