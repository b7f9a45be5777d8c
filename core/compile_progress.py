"""What is said on standard error while kernels are loaded from disk or compiled, if that takes long."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic

ANNOUNCE_AFTER = 1.0  # s; loading kernels from disk is faster than this on most machines

_loaded, _compiled = 0, 0  # kernels of this process


def note(*, compiled: bool) -> None:
    """A kernel is about to be compiled, or has been loaded."""
    global _loaded, _compiled  # one process has one compiler
    _loaded, _compiled = _loaded + (not compiled), _compiled + compiled


@contextmanager
def announced(what: str) -> Generator[None]:
    """Say on standard error what becomes of these kernels, if that takes long: the first use after installation.

    A terminal is shown how many there have been so far; elsewhere it is one line.
    """
    done = threading.Event()
    teller = threading.Thread(target=_tell, args=(what, done, _loaded, _compiled), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell(what: str, done: threading.Event, loaded: int, compiled: int) -> None:
    began, said, terminal = monotonic(), "", sys.stderr.isatty()
    while not done.wait(ANNOUNCE_AFTER):
        if _compiled > compiled:
            line = f"slamgauge: compiling {what} (once{'' if terminal else ' per installation'}) ..."
        elif _loaded > loaded:
            line = f"slamgauge: loading {what} from disk ..."
        else:
            continue
        if terminal:
            count = _compiled - compiled or _loaded - loaded
            print(f"\r{line} {count} so far, {monotonic() - began:.0f} s", end="", file=sys.stderr, flush=True)
        elif line != said:
            print(line, file=sys.stderr)
        said = line
    if terminal and said:
        print(file=sys.stderr)
