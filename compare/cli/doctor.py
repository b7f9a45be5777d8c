"""`slamgauge doctor`."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter

from slamgauge.compare.cli.options import print_result
from slamgauge.compare.studies.executors import BLAS_VARIABLES
from slamgauge.version import __version__

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "matplotlib", "pydantic", "tyro", "tqdm")
EXTRAS = ("distributed",)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
WARM_UPS = {  # module and function that make kernels ready
    "filter": ("slamgauge.ekf.kernels.warm_up", "compile_once"),
    "graph": ("slamgauge.graph_baseline.solver.warm_up", "compile_graphs_once"),
}
MISSING, BROKEN = "missing", "broken: "
MEGABYTE, GIGABYTE = 1e6, 1e9


@dataclass
class Doctor:
    """Say what a report of a defect needs: versions, BLAS, threads, kept machine code, gtsam, programs, free memory.

    Exit status 1 if something is missing that slamgauge needs.

    For example:
      slamgauge doctor
    """

    clear_cache: bool = False
    """Remove the kept machine code first; what is needed of it is compiled anew."""

    json: bool = False
    """Print JSON on standard output instead of the table."""

    def __call__(self) -> int:
        """Look, print; the exit status."""
        from slamgauge.compare.scoring.text_page import Page

        if self.clear_cache:
            print(f"kept machine code: {_clear()} files removed", file=sys.stderr)
        found = examine()
        page = Page(tuple(f"{name:17}  {text}" for name, text in found.items()))
        print_result(found if self.json else page)
        return 1 if any(text == MISSING or text.startswith(BROKEN) for text in found.values()) else 0


def examine() -> dict[str, str]:
    """What there is, each in a line, and after the versions what works of it."""
    system = f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} cores"
    found = {"slamgauge": f"{__version__}, {Path(__file__).parents[2]}"}
    found |= {"Python": f"{platform.python_version()}, {sys.executable}", "system": system}
    found |= {name: _version(name, MISSING) for name in LIBRARIES}
    found["gtsam"] = _version("gtsam", "not installed (gtsam-batch, isam2, fixed-lag and robust-batch need it)")
    found |= {name: _version(name, "not installed (an extra)") for name in EXTRAS}
    found["BLAS"] = _attempt(_blas)
    threads = [f"{name}={os.environ[name]}" for name in BLAS_VARIABLES if name in os.environ]
    found["threads"] = ", ".join(threads)
    found |= {f"{kernels} kernels": _attempt(_warm(*warm_up)) for kernels, warm_up in WARM_UPS.items()}
    found["kept machine code"] = _attempt(_kept)
    found["browser"] = next(filter(None, map(shutil.which, BROWSERS)), "none found (pages open in any)")
    found["ffmpeg"] = shutil.which("ffmpeg") or "none found (animations are GIF alone)"
    found["free memory"] = _attempt(_memory)
    return found


def _version(name: str, otherwise: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return otherwise


def _attempt(look: Callable[[], str]) -> str:
    """What a look finds, or why it fails: a doctor who falls ill helps nobody."""
    try:
        return look()
    except Exception as error:  # noqa: BLE001 whatever it is, it is the finding
        return f"{BROKEN}{type(error).__name__}: {' '.join(str(error).split())}"


def _blas() -> str:
    import numpy as np
    import scipy

    def named(library: object) -> str:
        used = library.show_config(mode="dicts")["Build Dependencies"]["blas"]  # pyright: ignore[reportAttributeAccessIssue]
        return f"{used['name']} {used['version']}"

    return f"numpy: {named(np)}; scipy: {named(scipy)}"


def _warm(module: str, warm_up: str) -> Callable[[], str]:
    """Make kernels ready, and say how long that took."""

    def look() -> str:
        begin = perf_counter()
        getattr(importlib.import_module(module), warm_up)()
        return f"ready in {perf_counter() - begin:.1f} s"

    return look


def _kept() -> str:
    from slamgauge.kernel_cache import kept_files

    kept = kept_files()
    sizes = [file.stat().st_size for files in kept.values() for file in files]
    where = ", ".join(map(str, kept)) or "nowhere: no folder may be written to; name one in NUMBA_CACHE_DIR"
    return f"{len(sizes)} files, {sum(sizes) / MEGABYTE:.1f} MB, {where}"


def _memory() -> str:
    from slamgauge.memory import free_memory

    return f"{free_memory() / GIGABYTE:.1f} GB"


def _clear() -> int:
    """Remove all kernels' machine code from the disk; how many files are gone."""
    for module, _ in WARM_UPS.values():  # each imports kernels of its folder
        importlib.import_module(module)
    from slamgauge.kernel_cache import clear_kept

    return clear_kept()
