"""What a bug report needs: `slamgauge doctor`.

Libraries are imported inside functions, because one that is missing or broken is a finding.
"""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter

from slamgauge.blas_threads import VARIABLES
from slamgauge.compare.cli.options.machine import Doctor
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.scoring.text_page import Page
from slamgauge.version import __version__

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "matplotlib", "pydantic", "tyro", "tqdm")
EXTRAS = ("distributed",)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
WARM_UPS = {"filter": ("slamgauge.ekf", "ekf_slam"), "graph": ("slamgauge.graph_baseline", "causal")}  # estimators
MISSING, BROKEN = "missing", "broken: "
MEGABYTE, GIGABYTE = 1e6, 1e9


def run(command: Doctor) -> int:
    """Run the command; return the exit status."""
    if command.clear_cache:
        from slamgauge import jit

        files = jit.stored_files()
        for file in files:
            file.unlink(missing_ok=True)
        print(f"kept machine code: {len(files)} files removed", file=sys.stderr)
    found = examine()
    Output(command.json).show(found, Page(tuple(f"{name:17}  {text}" for name, text in found.items())))
    return 1 if any(text == MISSING or text.startswith(BROKEN) for text in found.values()) else 0


def examine() -> dict[str, str]:
    """Return a line about each library, kernel, folder and program, by name."""
    system = f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} cores"
    found = {"slamgauge": f"{__version__}, {Path(__file__).parents[2]}"}
    found |= {"Python": f"{platform.python_version()}, {sys.executable}", "system": system}
    found |= {name: _version(name, MISSING) for name in LIBRARIES}
    found["gtsam"] = _version("gtsam", "not installed (gtsam-batch, isam2 and fixed-lag need it)")
    found |= {name: _version(name, "not installed (an extra)") for name in EXTRAS}
    found["BLAS"] = _attempt(_blas)
    found["threads"] = ", ".join(f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ)
    found |= {f"{kernels} kernels": _attempt(partial(run_shortly, *each)) for kernels, each in WARM_UPS.items()}
    found["kept machine code"] = _attempt(_kept)
    found["browser"] = next(filter(None, map(shutil.which, BROWSERS)), "none found (pages open in any)")
    found["free memory"] = _attempt(_memory)
    return found


def _version(name: str, otherwise: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return otherwise


def _attempt(look: Callable[[], str]) -> str:
    """Return what `look` returns, or a line with its error."""
    try:
        return look()
    except Exception as error:  # noqa: BLE001 any error is a finding
        return f"{BROKEN}{type(error).__name__}: {' '.join(str(error).split())}"


def _blas() -> str:
    import numpy as np
    import scipy

    def named(library: object) -> str:
        used = library.show_config(mode="dicts")["Build Dependencies"]["blas"]  # pyrefly: ignore[missing-attribute]
        return f"{used['name']} {used['version']}"

    return f"numpy: {named(np)}; scipy: {named(scipy)}"


def run_shortly(module: str, estimator: str) -> str:
    """Run an estimator on one second of a scenario, which compiles or loads its kernels."""
    from slamgauge.compare.scenarios.scenario import load_scenario
    from slamgauge.compare.scenarios.simulation import simulate

    begin = perf_counter()
    recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)[1]
    getattr(importlib.import_module(module), estimator)(recording)
    return f"ready in {perf_counter() - begin:.1f} s"


def _kept() -> str:
    from slamgauge import jit

    files = jit.stored_files()
    return f"{len(files)} files, {sum(file.stat().st_size for file in files) / MEGABYTE:.1f} MB, {jit.caches()}"


def _memory() -> str:
    from slamgauge.memory import free_memory

    return f"{free_memory() / GIGABYTE:.1f} GB"
