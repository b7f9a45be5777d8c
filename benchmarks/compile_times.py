"""Measure the time of commands without compiled kernels, and again with them.

    python benchmarks/compile_times.py [--only NAME] [--slowest 20]

Each command runs twice with a new kernel cache: the first run compiles its kernels, the second run loads them. Python's
bytecode exists already, as after `pip install`. Times
are processor times of the command and its workers. `--slowest` also lists the kernels with the longest compilation
times, which do not include the kernels that they call. `--only` selects commands with NAME in their title.
"""

from __future__ import annotations

import compileall
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import tyro

ROOT = Path(__file__).parents[1]
RUN = ["run", "q1-long-dense", "--estimators", "dead-reckoning,ekf,riekf,causal,batch", "--out", "run"]
EXERCISE = ["exercise", "q1", "--runs", "20", "--out", "exercise"]
COMMANDS = {
    "exercise q1 (README)": EXERCISE,
    "run q1-long-dense": RUN,
    "run, ekf only": [*RUN[:3], "ekf", "--out", "ekf"],
    "study q1-short-dense": ["study", "q1-short-dense", "--runs", "4", "--estimators", "ekf,riekf", "--out", "study"],
    "run q2-long-dense, ekf": ["run", "q2-long-dense", "--estimators", "ekf", "--out", "q2"],
    "run q4-ring, ekf": ["run", "q4-ring", "--estimators", "ekf", "--out", "q4"],
    "--version": ["--version"],
    "--help": ["--help"],
    "a usage error": ["run", "nowhere"],
}


def main(only: str = "", slowest: int = 0) -> None:
    if not any(only in name for name in COMMANDS):
        sys.exit(f"--only {only}: no command has it in its title; use one of {', '.join(COMMANDS)}")
    for folder in ("core", "ekf", "graph_baseline", "compare"):
        compileall.compile_dir(ROOT / folder, quiet=1)
    print(f"{'command':30}{'first [s]':>10}{'kernels':>9}{'again [s]':>11}")
    for name, words in COMMANDS.items():
        if only in name:
            with tempfile.TemporaryDirectory() as folder:
                first, again = user_seconds(words, folder), user_seconds(words, folder)
                kernels = len(list(Path(folder, "kernels").rglob("*.nbc")))
                print(f"{name:30}{first:10.1f}{kernels:9d}{again:11.2f}", flush=True)
            if slowest:
                code = f"import runpy; runpy.run_path({__file__!r})['list_kernels']({words}, {slowest})"
                with tempfile.TemporaryDirectory() as folder:
                    subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment(folder), check=False)


def user_seconds(words: list[str], folder: str) -> float:
    """Return the processor time [s] of a command that runs in `folder`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    command = [sys.executable, "-m", "slamgauge", *words]
    subprocess.run(command, cwd=folder, env=environment(folder), check=False, capture_output=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def environment(folder: str) -> dict[str, str]:
    """Return an environment with the kernel cache in `folder`."""
    return {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "NUMBA_CACHE_DIR": str(Path(folder, "kernels"))}


def list_kernels(words: list[str], most: int) -> None:
    """Run a command in this process and print the kernels with the longest compilation times."""
    from time import process_time

    from numba.core import event

    from slamgauge.compare.cli.main import main as command

    rows: list[tuple[float, str]] = []
    running: list[list[float]] = []  # start of a compilation, and time of the kernels that it calls

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:  # noqa: ARG002
            running.append([process_time(), 0.0])

        def on_end(self, event: Any) -> None:
            start, called = running.pop()
            spent = process_time() - start
            if running:
                running[-1][1] += spent
            rows.append((spent - called, event.data["dispatcher"].py_func.__qualname__))

    with event.install_listener("numba:compile", Listener()):
        command(words)
    total = sum(spent for spent, _ in rows)
    print(f"\n{len(rows)} specialisations of {len({name for _, name in rows})} kernels, {total:.1f} s")
    for spent, name in sorted(rows, reverse=True)[:most]:
        print(f"{spent:8.2f}  {name}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
