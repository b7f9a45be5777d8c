"""The program installed in another folder, with the compiled kernels of this checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("compare", "ekf", "graph_baseline")


def install_in(folder: Path) -> None:
    """Copy the sources and their compiled kernels."""
    sources = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "core", folder / "slamgauge", ignore=sources)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / "slamgauge" / package, ignore=sources)
    lend_kernels(folder)


def lend_kernels(folder: Path) -> None:
    """Copy compiled kernels to the copied sources, so that nothing is compiled again."""
    for package in ("", *PACKAGES):
        for kept in (ROOT / (package or "core")).rglob("*.nb?"):
            there = folder / "slamgauge" / package / kept.relative_to(ROOT / (package or "core"))
            there.parent.mkdir(exist_ok=True)
            shutil.copy2(kept, there)


def run_in(folder: Path, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with the program in `folder` first on the import path."""
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(folder)
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def first_and_later_use(folder: Path, program: str, kernels: str) -> list[subprocess.CompletedProcess[str]]:
    """Run a program twice, the first time without compiled `kernels`."""
    install_in(folder)
    for kept in folder.rglob(f"{kernels}*.nb?"):
        kept.unlink()
    return [run_in(folder, "-c", program, cwd=folder) for _ in range(2)]
