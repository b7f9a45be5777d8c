"""People's files are scripts as a rule: what they draw while they are loaded opens no window and waits for nobody."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

BACKEND = "MPLBACKEND"  # read by matplotlib when it is first imported
WINDOWED = {"matplotlib": ("use",), "matplotlib.pyplot": ("show", "pause")}

_held: dict[tuple[str, str], Callable[..., Any]] | None = None  # what stands in for nothing while files are loaded


@contextmanager
def without_windows() -> Generator[None]:
    """Nothing that is loaded in here shows figures or waits for them; those that it made are closed at the end."""
    global _held
    if _held is not None:
        yield
        return
    environment, figures = os.environ.get(BACKEND), _figures()
    os.environ[BACKEND] = "agg"
    if "matplotlib" in sys.modules and "matplotlib.pyplot" not in sys.modules:
        sys.modules["matplotlib"].use("agg")
    _held = {}
    hold_windows()
    try:
        yield
    finally:
        for (module, name), function in _held.items():
            setattr(sys.modules[module], name, function)
        _held = None
        for number in _figures() - figures:
            sys.modules["matplotlib.pyplot"].close(number)
        if environment is None:
            del os.environ[BACKEND]
        else:
            os.environ[BACKEND] = environment


def hold_windows() -> None:
    """Within `without_windows`: also hold what has been imported since."""
    if _held is None:
        return
    for module, names in WINDOWED.items():
        for name in names:
            function = getattr(sys.modules.get(module), name, None)  # none while matplotlib itself is being imported
            if function is not None and (module, name) not in _held:
                _held[module, name] = function
                setattr(sys.modules[module], name, _nothing)


def _nothing(*_: object, **__: object) -> None:
    """What a window does that nobody sees."""


def _figures() -> set[int]:
    """Numbers of the open figures."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    return set() if pyplot is None else {*pyplot.get_fignums()}
