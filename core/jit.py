"""Compilation of kernels by numba on first use.

A kernel is a function that Python calls: its machine code is stored on disk together with that of all functions that it
calls. The folder is named after a digest of the paths and contents of all sources with kernels, so that no old code
runs after a change; NUMBA_CACHE_DIR names another place for these folders. With NUMBA_DISABLE_JIT=1 kernels are plain
Python functions that a debugger can enter.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from numba import config, njit, typeof
from numba.core import event
from numba.extending import overload, register_jitable

from slamgauge.arrays import select
from slamgauge.notices import tell_once

NUMBA: Any = config  # its variables have no types
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

PACKAGES = ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline")  # with kernels
MARK = b"slamgauge.jit"  # in every module with kernels
FORMULAS = ("arrays.py", "se2.py", "sensors.py", "validation.py")  # functions and numbers that kernels compile
FIRST_USE = "compiling kernels on first use, once for each version ..."
NOT_STORED = "{}: no compiled code can be stored there; kernels are compiled again in each process; set NUMBA_CACHE_DIR"


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function that Python calls, on its first call; other kernels may call it too."""
    folder, before = caches(), NUMBA.CACHE_DIR
    NUMBA.CACHE_DIR = "" if folder is None else str(folder)  # not for functions of users
    try:
        return njit(cache=folder is not None, error_model="numpy")(function)
    finally:
        NUMBA.CACHE_DIR = before


def inner(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let kernels call a Python function: they compile it with themselves."""
    return register_jitable(error_model="numpy")(function)


def direct(function: Callable[Arguments, Result], *arguments: object) -> Callable[Arguments, Result]:
    """Return the machine code of a kernel for arguments of these types, compiled if necessary.

    Calls of the machine code skip numba's check of argument types (1 us for a dozen arrays): the types must be the same
    each time. A plain Python function is returned unchanged.
    """
    compiled: Any = function
    return compiled.compile(tuple(map(typeof, arguments))) if hasattr(function, "signatures") else function


@cache
def caches() -> Path | None:
    """Return the folder of the machine code of these sources; None if no folder can be written to.

    A folder that can only be read is copied to a temporary one.
    """
    folder, copied = parent() / digest(), None
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    with suppress(OSError):
        copied = Path(tempfile.mkdtemp(prefix="slamgauge-kernels-"))
        atexit.register(shutil.rmtree, copied, ignore_errors=True)
        return shutil.copytree(folder, copied, dirs_exist_ok=True)
    tell_once(NOT_STORED.format(folder))
    return copied


def stored_files() -> list[Path]:
    """Return the files of stored machine code."""
    folder = caches()
    return [] if folder is None else [*folder.rglob("*.nb[ic]")]


def parent() -> Path:
    """Return the folder in which each version has its folder of machine code."""
    if NUMBA.CACHE_DIR:
        return Path(NUMBA.CACHE_DIR) / "slamgauge"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "slamgauge"


def digest() -> str:
    """Return a digest of the paths and contents of all sources with kernels or formulas."""
    found = hashlib.sha256()
    for package in PACKAGES:
        spec = find_spec(package)
        folders = [] if spec is None else spec.submodule_search_locations or []
        for path in sorted(file for folder in folders for file in Path(folder).rglob("*.py")):
            source = path.read_bytes()
            if MARK in source or path.name in FORMULAS:
                found.update(f"{path} {len(source)}\n".encode() + source)
    return found.hexdigest()[:16]


class _Compilation(event.Listener):
    """Prints a line before a compilation, and disables the garbage collector, which takes a tenth of its time."""

    def on_start(self, event: Any) -> None:
        if gc.isenabled():
            gc.disable()
            event.data["restart"] = True
        if event.data["dispatcher"].py_func.__module__.partition(".")[0] == "slamgauge":
            tell_once(FIRST_USE)

    def on_end(self, event: Any) -> None:
        if event.data.pop("restart", False):
            gc.enable()


event.register("numba:compile", _Compilation())


@overload(select, jit_options={"error_model": "numpy"}, strict=False)
def _select(*_types: Any) -> Callable[..., Any]:
    """Return `select` for numbers, as kernels compile it."""
    return lambda condition, one, other: one if condition else other
