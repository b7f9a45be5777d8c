"""What a bug report needs: `slamgauge doctor`."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter

from slamgauge import jit, memory
from slamgauge.blas_threads import VARIABLES
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.scenarios import scenario, simulation
from slamgauge.compare.scoring import text_page
from slamgauge.version import __version__

MISSING, BROKEN = "missing", "broken: "
LIBRARIES = dict.fromkeys(("numpy", "scipy", "numba", "llvmlite", "matplotlib", "pydantic", "tyro", "tqdm"), MISSING)
OPTIONAL = {"gtsam": "not installed (gtsam-batch, isam2 and fixed-lag need it)", "distributed": "not installed"}
WARM_UPS = {"filter": ("slamgauge.ekf", "ekf_slam"), "graph": ("slamgauge.graph_baseline", "causal")}  # estimators


@dataclass
class Command:
    """Print what a bug report needs: versions, BLAS, threads, compiled code, gtsam and free memory.

    Exit status 1 if something that slamgauge needs is missing.

    For example:
      slamgauge doctor

    Attributes:
        json: Print JSON on standard output instead of the table.
    """

    json: bool = False

    def run(self) -> int:
        found = {"slamgauge": f"{__version__}, {Path(__file__).parents[2]}"}
        found["Python"] = f"{platform.python_version()}, {sys.executable}"
        found["system"] = f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} cores"
        for name, otherwise in (LIBRARIES | OPTIONAL).items():
            try:
                found[name] = version(name)
            except PackageNotFoundError:
                found[name] = otherwise
        found["BLAS"] = _attempt(_blas)
        found["threads"] = ", ".join(f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ)
        found |= {f"{kernels} kernels": _attempt(partial(run_shortly, *each)) for kernels, each in WARM_UPS.items()}
        found["machine code"] = _attempt(lambda: f"{len(jit.stored_files())} files, {jit.caches()}")
        found["free memory"] = _attempt(lambda: f"{memory.free_memory() / memory.GIGABYTE:.1f} GB")
        Output(self.json).show(found, text_page.Page(tuple(f"{name:14}  {text}" for name, text in found.items())))
        return 1 if any(text == MISSING or text.startswith(BROKEN) for text in found.values()) else 0


def _attempt(look: Callable[[], str]) -> str:
    """Return what `look` returns, or a line with its error: a broken library is a finding."""
    try:
        return look()
    except Exception as error:  # noqa: BLE001 any error is a finding
        return f"{BROKEN}{type(error).__name__}: {' '.join(str(error).split())}"


def _blas() -> str:
    built = {name: importlib.import_module(name).show_config(mode="dicts") for name in ("numpy", "scipy")}
    used = {name: each["Build Dependencies"]["blas"] for name, each in built.items()}
    return "; ".join(f"{name}: {blas['name']} {blas['version']}" for name, blas in used.items())


def run_shortly(module: str, estimator: str) -> str:
    """Run an estimator on one second of a scenario, which compiles or loads its kernels."""
    begin = perf_counter()
    recording = simulation.simulate(scenario.load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)[1]
    getattr(importlib.import_module(module), estimator)(recording)
    return f"ready in {perf_counter() - begin:.1f} s"
