"""Loading of user scripts without windows: figures that they draw are neither shown nor waited for."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

BACKEND = "MPLBACKEND"  # matplotlib reads it at its first import
WINDOWED = {"matplotlib": ("use",), "matplotlib.pyplot": ("show", "pause")}

_restores: ExitStack | None = None  # restores the functions of matplotlib that `hold_windows` replaced


@contextmanager
def without_windows() -> Generator[None]:
    """Disable windows and pauses of matplotlib, and close at the end the figures that were made inside."""
    global _restores
    if _restores is not None:
        yield
        return
    environment, figures = os.environ.get(BACKEND), _figures()
    os.environ[BACKEND] = "agg"
    if "matplotlib" in sys.modules and "matplotlib.pyplot" not in sys.modules:
        sys.modules["matplotlib"].use("agg")
    try:
        with ExitStack() as _restores:
            hold_windows()
            yield
    finally:
        _restores = None
        for number in _figures() - figures:
            sys.modules["matplotlib.pyplot"].close(number)
        if environment is None:
            del os.environ[BACKEND]
        else:
            os.environ[BACKEND] = environment


def hold_windows() -> None:
    """Disable the windows of modules that have been imported since `without_windows` began; do nothing outside it."""
    if _restores is None:
        return
    for name, functions in WINDOWED.items():
        module = sys.modules.get(name)
        for each in functions:
            function = getattr(module, each, None)  # missing while matplotlib itself is being imported
            if function is not None and function is not _nothing:
                _restores.callback(setattr, module, each, function)
                setattr(module, each, _nothing)


def _nothing(*_: object, **__: object) -> None:
    """Do nothing, in place of a function that opens or waits for a window."""


def _figures() -> set[int]:
    """Return the numbers of the open figures."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    return set() if pyplot is None else {*pyplot.get_fignums()}
