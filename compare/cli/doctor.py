"""What a bug report needs: `slamgauge doctor`."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import distributions
from pathlib import Path
from time import perf_counter

from slamgauge import jit, memory
from slamgauge.blas_threads import VARIABLES
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.scenarios import scenario, simulation
from slamgauge.compare.scoring import table
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
        found["threads"] = ", ".join(f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ)
        for name, otherwise in (LIBRARIES | OPTIONAL).items():
            found[name] = next((each.version for each in distributions(name=name)), otherwise)
        looks: dict[str, Callable[[], str]] = {"BLAS": _blas}
        looks |= {f"{kernels} kernels": partial(run_shortly, *each) for kernels, each in WARM_UPS.items()}
        looks["machine code"] = lambda: f"{len(jit.stored_files())} files, {jit.caches()}"
        looks["free memory"] = lambda: f"{memory.free_memory() / memory.GIGABYTE:.1f} GB"
        for name, look in looks.items():
            try:
                found[name] = look()
            except Exception as error:  # noqa: BLE001 any error is a finding
                found[name] = f"{BROKEN}{type(error).__name__}: {' '.join(str(error).split())}"
        Output(self.json).show(found, table.Page(tuple(f"{name:14}  {text}" for name, text in found.items())))
        return 1 if any(text == MISSING or text.startswith(BROKEN) for text in found.values()) else 0


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
