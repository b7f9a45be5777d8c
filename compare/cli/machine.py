"""This computer: its step times (`slamgauge bench`) and what is installed on it (`slamgauge doctor`)."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter

from slamgauge.blas_threads import VARIABLES
from slamgauge.compare.cli.options import Estimators, Folder, results_folder, split_names
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import BENCHED
from slamgauge.errors import UserError
from slamgauge.version import __version__

LONGEST = 12  # digits of a map size: Python parses some thousands
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "matplotlib", "pydantic", "tyro", "tqdm")
EXTRAS = ("distributed",)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
WARM_UPS = {"filter": ("slamgauge.ekf", "ekf_slam"), "graph": ("slamgauge.graph_baseline", "causal")}  # estimators
MISSING, BROKEN = "missing", "broken: "
MEGABYTE, GIGABYTE = 1e6, 1e9


@dataclass
class Bench:
    """Measure step times for several map sizes, next to a plain numpy filter (the four default sizes take 20 minutes).

    For example:
      slamgauge bench --landmarks 20,100 --estimators ekf,riekf
    """

    landmarks: str = "20,100,300,1000"
    """Comma-separated map sizes."""

    estimators: Estimators = BENCHED

    out: Folder | None = None
    """Folder of bench.json, bench.png and bench.svg. Without it they are not written."""

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        from slamgauge.compare.bench.step_times import bench_table, require_room_for_bench, run_bench
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.storage.result_files import BENCH, BENCH_FILES

        words = [word.strip() for word in self.landmarks.split(",")]
        if not all(word.isdecimal() and len(word) <= LONGEST and int(word) > 0 for word in words):
            raise UserError(f"landmarks {self.landmarks!r:.60}: give map sizes > 0, for example 20,100")
        sizes = [int(word) for word in words]
        require_room_for_bench(sizes)
        with results_folder(self.out, BENCH_FILES, last=BENCH) as folder:
            result = run_bench(sizes, split_names(self.estimators))
            self.output.show(result, bench_table(result))
            if folder is not None:
                write_json(folder / BENCH, result)
        if self.out is None:
            return 0
        from slamgauge.compare.figures.publishing import draw_stored

        return 0 if draw_stored(self.out, BENCH) else 1


@dataclass
class Doctor:
    """Print what a bug report needs: versions, BLAS, threads, compiled code, gtsam, programs and free memory.

    Exit status 1 if something that slamgauge needs is missing.

    For example:
      slamgauge doctor
    """

    clear_cache: bool = False
    """First remove the stored machine code; slamgauge then compiles again what it needs."""

    json: bool = False
    """Print JSON on standard output instead of the table."""

    def __call__(self) -> int:
        from slamgauge.compare.scoring.text_page import Page

        if self.clear_cache:
            from slamgauge.jit import stored_files

            files = stored_files()
            for file in files:
                file.unlink(missing_ok=True)
            print(f"kept machine code: {len(files)} files removed", file=sys.stderr)
        found = examine()
        Output(self.json).show(found, Page(tuple(f"{name:17}  {text}" for name, text in found.items())))
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
    from importlib.metadata import PackageNotFoundError, version

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
    from slamgauge.jit import caches, stored_files

    files = stored_files()
    return f"{len(files)} files, {sum(file.stat().st_size for file in files) / MEGABYTE:.1f} MB, {caches()}"


def _memory() -> str:
    from slamgauge.memory import free_memory

    return f"{free_memory() / GIGABYTE:.1f} GB"
