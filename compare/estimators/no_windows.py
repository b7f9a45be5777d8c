"""User code without windows: while it is loaded or runs, figures of matplotlib are neither shown nor waited for."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

BACKEND = "MPLBACKEND"  # matplotlib reads it at its first import
WINDOWED = {
    "matplotlib": ("use",),
    "matplotlib.pyplot": ("show", "pause", "ginput", "waitforbuttonpress"),
}

_lock = threading.RLock()
_users = 0  # contexts that are open, in any thread
_restores = ExitStack()  # restores what the first of them replaced


@contextmanager
def without_windows() -> Generator[None]:
    """Disable windows and pauses of matplotlib, and close at the end the figures that were made inside.

    Several threads may be inside; the last one that leaves restores matplotlib.
    """
    global _users
    with _lock:
        _users += 1
        if _users == 1:
            _begin()
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if not _users:
                _restores.close()


def hold_windows() -> None:
    """Disable the windows of modules that have been imported since `without_windows` began; do nothing outside it."""
    with _lock:
        if not _users:
            return
        for name, functions in WINDOWED.items():
            module = sys.modules.get(name)
            for each in functions:
                function = getattr(module, each, None)  # missing while matplotlib itself is being imported
                if function is not None and function is not _nothing:
                    _restores.callback(setattr, module, each, function)
                    setattr(module, each, _nothing)


def _begin() -> None:
    _restores.callback(_set_backend, os.environ.get(BACKEND))
    _restores.callback(_close_figures, _figures())
    os.environ[BACKEND] = "agg"
    if "matplotlib" in sys.modules and "matplotlib.pyplot" not in sys.modules:
        sys.modules["matplotlib"].use("agg")
    hold_windows()


def _set_backend(name: str | None) -> None:
    if name is None:
        os.environ.pop(BACKEND, None)
    else:
        os.environ[BACKEND] = name


def _close_figures(kept: set[int]) -> None:
    for number in _figures() - kept:
        sys.modules["matplotlib.pyplot"].close(number)


def _nothing(*_: object, **__: object) -> None:
    """Replace a function that opens a window or waits for one."""


def _figures() -> set[int]:
    """Return the numbers of the open figures."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    return set() if pyplot is None else {*pyplot.get_fignums()}
