"""Cache of the kernels' machine code on disk.

The machine code of a kernel includes the code of the kernels that it calls, but numba compares it with the kernel's own
source file only: the old code of an edited kernel would remain in its callers. Each cached file therefore contains a
seal: a digest of the machine code, of the kernel's module and of all project modules which that module imports. If the
seal differs (an edited source, or half a file after a power cut), the kernel is compiled again. Contents are compared,
not dates.

The machine code of a checkout lies next to its sources, that of an installed package in the user's cache folder: pip
does not remove files that it did not install, and a folder `slamgauge` that remained in site-packages would hide an
editable install. NUMBA_CACHE_DIR names another folder for both.
"""

from __future__ import annotations

import gc
import hashlib
import re
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from time import monotonic, sleep
from typing import IO, Any, cast

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    NullCache,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

from slamgauge.compile_progress import announced, note

fcntl: Any = None  # locks of files, which Windows lacks
with suppress(ImportError):
    import fcntl

PATIENCE = 120.0  # s; longer than all kernels take
LOCK = "compiling.lock"  # in the first folder of the cache
COMPILER = "slamgauge.jit"  # its changes affect all kernels
INSTALLED = {"site-packages", "dist-packages"}  # folders that pip installs into
_IMPORT = re.compile(r"^(?:from ([\w.]+) import (\([^)]*\)|[^\n]*)|import ([\w., ]+))", re.MULTILINE)
_folders: dict[Path, None] = {}  # cache folders of the kernels imported so far


class DamagedError(Exception):
    """A cached file is damaged, or was made from other sources."""


class _ReadOnly:
    """Accepts a folder that cannot be written to if it contains machine code: processes with user code only read it."""

    def ensure_cache_path(self) -> None:
        """Make the folder; raise OSError if it cannot be used. A folder is checked once per process."""
        if Path(self.get_cache_path()) in _folders:  # numba's locators have it  # pyrefly: ignore[missing-attribute]
            return
        try:
            super().ensure_cache_path()  # numba's locators have it  # pyrefly: ignore[missing-attribute]
        except OSError:
            if not any(Path(self.get_cache_path()).glob("*.nbi")):  # pyrefly: ignore[missing-attribute]
                raise


class _Provided(_ReadOnly, UserProvidedCacheLocator):
    """The folder NUMBA_CACHE_DIR."""


class _UserWide(_ReadOnly, UserWideCacheLocator):
    """The user's cache folder."""


class _InCheckout(_ReadOnly, InTreeCacheLocator):
    """Stores machine code next to the sources, unless pip installed them."""

    @classmethod
    def from_function(cls, py_func: Callable[..., object], py_file: str) -> Any:
        """Return a locator for the function, or None if its file is installed or its folder cannot be written to."""
        return None if INSTALLED & {*Path(py_file).parts} else super().from_function(py_func, py_file)


class _Sealed(CompileResultCacheImpl):
    """Writes and reads the machine code of a function, with its seal."""

    _locator_classes = [_Provided, _InCheckout, _UserWide, InTreeCacheLocator]  # noqa: RUF012 as in numba

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        self._module = function.__module__

    def reduce(self, cres: Any) -> tuple[str, Any]:
        """Return the content of the file: the seal and the parts that numba writes."""
        parts = super().reduce(cres)
        return self._seal(parts), parts

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the machine code in the content of a file."""
        seal, parts = payload
        if seal != self._seal(parts):
            raise DamagedError
        return super().rebuild(target_context, parts)

    def _seal(self, parts: Any) -> str:
        library = parts[0]  # the machine code; a file damaged elsewhere cannot be unpickled
        return hashlib.sha256(sources_digest(self._module) + repr(library).encode()).hexdigest()


class _KernelCache(FunctionCache):
    """numba's cache of a function, without errors: damaged files are replaced, and a full disk is ignored."""

    _impl_class = _Sealed

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for these types, None if it must be compiled."""
        found = None
        try:
            found = super().load_overload(sig, target_context)
            damaged = found is not None and tuple(found.signature.args) != tuple(sig)  # two programs wrote at once
        except Exception:  # noqa: BLE001 a damaged pickle may raise any error
            damaged = True
        if damaged:
            found = None
            with suppress(OSError):  # the folder is read-only
                self.flush()
        note(compiled=found is None)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write machine code if possible."""
        with suppress(Exception):  # a full disk, or a damaged index that cannot be replaced
            super().save_overload(sig, data)


class _SealedEntry(_Sealed):
    """Machine code that Python calls, in files of its own."""

    @property
    def filename_base(self) -> str:
        """Return the beginning of the names of these files."""
        return f"{super().filename_base}-entry"


class _EntryCache(_KernelCache):
    """Cache of machine code that Python calls."""

    _impl_class = _SealedEntry


class _NoCache(NullCache):
    """No cache: numba can write to no folder."""

    def load_overload(self, sig: Any, target_context: Any) -> None:  # noqa: ARG002
        """Return None: nothing is cached."""
        note(compiled=True)


def cache_of(function: Callable[..., object], *, callable_from_python: bool) -> FunctionCache | NullCache:
    """Return the cache for the machine code of a function."""
    try:
        found = (_EntryCache if callable_from_python else _KernelCache)(function)
    except RuntimeError:  # numba can write to no folder
        return _NoCache()
    _folders[Path(cast("str", found.cache_path))] = None
    return found


@contextmanager
def compiling(what: str, kernels: int) -> Generator[None]:
    """Compile or load about this many kernels, and announce them if it takes long.

    Processes that share a cache take turns, so that each kernel is compiled once and the other processes load it.
    """
    with announced(what, kernels), ExitStack() as stack:
        if fcntl is not None and _folders:
            with suppress(OSError):  # a folder that this process may not write: it compiles without waiting
                lock = stack.enter_context((next(iter(_folders)) / LOCK).open("a"))
                _wait_for(lock)
        with _without_garbage_collection():
            yield


def _wait_for(lock: IO[str]) -> None:
    """Lock a file, or stop waiting for another process after PATIENCE seconds: a kernel is then compiled twice."""
    end = monotonic() + PATIENCE
    while monotonic() < end:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sleep(0.05)
        else:
            return


@contextmanager
def _without_garbage_collection() -> Generator[None]:
    """Disable the garbage collector, which takes a tenth of the time of a compilation."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@cache
def sources_digest(module: str) -> bytes:
    """Return a digest of names and contents: a module, all project modules that it imports, and `slamgauge.jit`."""
    digest = hashlib.sha256()
    for name, source in sorted(_sources({COMPILER, module}).items()):
        digest.update(f"{name} {len(source)}\n".encode() + source)
    return digest.digest()


def _sources(modules: set[str]) -> dict[str, bytes]:
    """Return the sources of modules, and of all modules of the same top-level packages that they import, by name."""
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
    """Return the cache folders of the kernels imported so far, and their files."""
    names = ("*.nbi", "*.nbc", "*.nb[ic].tmp.*")  # killed processes leave the last kind
    return {folder: sorted(file for name in names for file in folder.glob(name)) for folder in sorted(_folders)}


def clear_kept() -> int:
    """Remove these files; return their number."""
    files = [file for found in kept_files().values() for file in found]
    for file in files:
        file.unlink(missing_ok=True)
    return len(files)
