"""Machine code of kernels kept on disk, and when it may be reused.

The machine code of a kernel includes that of the kernels it calls, but numba compares it with its own source file
alone: an edited kernel would live on in its callers. Each kept file therefore carries a seal: a digest of the machine
code, of the kernel's module and of all modules of the project which that module imports. Code whose seal differs,
because a source was edited or because a power cut left half a file, is compiled again. Contents are compared, not
dates.

The machine code of a checkout lies next to its sources, that of an installed package in the user's cache folder: pip
does not remove files that it did not install, and a folder `slamgauge` that remained in site-packages would hide an
editable install. NUMBA_CACHE_DIR names another folder for both.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, cast

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    NullCache,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

from slamgauge.compile_progress import note

COMPILER = "slamgauge.jit"  # how kernels are compiled
INSTALLED = {"site-packages", "dist-packages"}  # folders that pip installs into
_IMPORT = re.compile(r"^(?:from ([\w.]+) import (\([^)]*\)|[^\n]*)|import ([\w., ]+))", re.MULTILINE)
_folders: set[Path] = set()  # where numba keeps the kernels that have been imported


class DamagedError(Exception):
    """What is kept is not what was written, or of other sources or types."""


class _InCheckout(InTreeCacheLocator):
    """Stores machine code next to the sources, unless pip installed them."""

    @classmethod
    def from_function(cls, py_func: Callable[..., object], py_file: str) -> Any:
        """Return a locator for the function, or None if its file is installed or its folder cannot be written to."""
        return None if INSTALLED & {*Path(py_file).parts} else super().from_function(py_func, py_file)


class _Sealed(CompileResultCacheImpl):
    """How the machine code of a function becomes a file, and a file machine code."""

    _locator_classes = (UserProvidedCacheLocator, _InCheckout, UserWideCacheLocator, InTreeCacheLocator)

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        self._module = function.__module__

    def reduce(self, cres: Any) -> tuple[str, Any]:
        """What is written: the seal, and what numba would write."""
        parts = super().reduce(cres)
        return self._seal(parts), parts

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Machine code of what was read."""
        seal, parts = payload
        if seal != self._seal(parts):
            raise DamagedError
        return super().rebuild(target_context, parts)

    def _seal(self, parts: Any) -> str:
        library = parts[0]  # the machine code; damage elsewhere cannot be read at all
        return hashlib.sha256(sources_digest(self._module) + repr(library).encode()).hexdigest()


class _KernelCache(FunctionCache):
    """numba's cache of a function; damaged files are as good as none, and a full disk does not end the program."""

    _impl_class = _Sealed

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code for these types, None where it must be compiled."""
        found = None
        try:
            found = super().load_overload(sig, target_context)
            damaged = found is not None and tuple(found.signature.args) != tuple(sig)  # two programs wrote at once
        except Exception:  # noqa: BLE001 half a pickle fails in every way
            damaged = True
        if damaged:
            found = None
            with suppress(OSError):  # the folder is not ours to write to
                self.flush()
        note(compiled=found is None)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code, if that can be done."""
        with suppress(Exception):  # no room, or a damaged index that cannot be replaced
            super().save_overload(sig, data)


class _NoCache(NullCache):
    """Where numba may write to no folder."""

    def load_overload(self, sig: Any, target_context: Any) -> None:  # noqa: ARG002
        """Nothing is kept."""
        note(compiled=True)


def cache_of(function: Callable[..., object]) -> FunctionCache | NullCache:
    """Where numba shall keep the machine code of a function."""
    try:
        found = _KernelCache(function)
    except RuntimeError:  # no folder that numba may write to
        return _NoCache()
    _folders.add(Path(cast("str", found.cache_path)))
    return found


@cache
def sources_digest(module: str) -> bytes:
    """Digest of the names and contents of a module, of all project modules that it imports, and of `slamgauge.jit`."""
    digest = hashlib.sha256()
    for name, source in sorted(_sources({COMPILER, module}).items()):
        digest.update(f"{name} {len(source)}\n".encode() + source)
    return digest.digest()


def _sources(modules: set[str]) -> dict[str, bytes]:
    """Sources of these modules, and of all modules of the same top-level packages that they import, by name."""
    found: dict[str, bytes] = {}
    roots, waiting = {name.partition(".")[0] for name in modules}, [*modules]
    while waiting:
        name = waiting.pop()
        file = getattr(sys.modules.get(name), "__file__", None)
        if name in found or file is None:
            continue
        found[name] = Path(file).read_bytes()
        for package, members, plain in _IMPORT.findall(found[name].decode()):
            named = [package, *(f"{package}.{member}" for member in re.findall(r"\w+", members))] if package else []
            named += re.findall(r"[\w.]+", plain)
            waiting += [each for each in named if each.partition(".")[0] in roots and each not in roots]
    return found


def kept_files() -> dict[Path, list[Path]]:
    """The folders in which machine code of the kernels imported so far is kept, and their files."""
    names = ("*.nbi", "*.nbc", "*.nb[ic].tmp.*")  # the last is left by processes that were killed
    return {folder: sorted(file for name in names for file in folder.glob(name)) for folder in sorted(_folders)}


def clear_kept() -> int:
    """Remove that machine code; how many files are gone."""
    files = [file for found in kept_files().values() for file in found]
    for file in files:
        file.unlink(missing_ok=True)
    return len(files)
