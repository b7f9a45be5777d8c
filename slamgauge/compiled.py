"""Compilation of kernels: by numba on first use, kept on disk for later processes.

The machine code of a kernel includes that of the kernels it calls, but numba compares its age with its own source file
alone: an edited kernel would live on in its callers. A folder that holds kernels therefore drops, when it is imported,
machine code older than any of its sources (`drop_outdated`), or than this one, which says how they are compiled.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from numba import njit, typeof
from numba.core.dispatcher import Dispatcher

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

ANNOUNCE_AFTER = 1.0  # s; loading kernels from the cache is faster than this


def drop_outdated(package: Path) -> None:
    """Remove numba's indices in the package's cache that are older than its newest source, or than this module."""
    newest = max(source.stat().st_mtime for source in (Path(__file__), *package.rglob("*.py")))
    for index in package.rglob("__pycache__/*.nbi"):
        try:
            if index.stat().st_mtime < newest:
                index.unlink()
        except OSError:  # another process was first, or the folder is not ours to write to
            continue


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile `function` on first call; machine code is cached on disk where that is possible."""
    return _compiled(function, callable_from_python=True)


def inner(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A kernel for other kernels alone: no way into it from Python is compiled, half the time where it is small."""
    return _compiled(function, callable_from_python=False)


def _compiled(function: Callable[Arguments, Result], *, callable_from_python: bool) -> Callable[Arguments, Result]:
    options: dict[str, Any] = {  # numba's stubs lack the last two
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not callable_from_python,
    }
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no folder that numba may write to
        return njit(**options)(function)


def direct(function: Callable[Arguments, Result], *arguments: object) -> Callable[Arguments, Result]:
    """The machine code of a kernel for arguments of these types, compiled if it is not yet.

    A call then spares numba's look at every argument's type, a microsecond where there are a dozen arrays: they must be
    of the same types each time. What is no kernel is returned as it is.
    """
    if not isinstance(function, Dispatcher):
        return function
    return function.compile(tuple(map(typeof, arguments)))


@contextmanager
def announced(what: str) -> Generator[None]:
    """Say on standard error that `what` is being compiled, if that takes long: the first use after installation."""
    announcement = threading.Timer(
        ANNOUNCE_AFTER,
        print,
        args=[f"slamgauge: compiling the {what} (once per installation, kept on disk) ..."],
        kwargs={"file": sys.stderr},
    )
    announcement.start()
    try:
        yield
    finally:
        announcement.cancel()
