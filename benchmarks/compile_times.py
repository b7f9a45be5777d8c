"""Measure the time of commands without compiled kernels, and again with them.

    python benchmarks/compile_times.py [--only NAME]

Each command runs twice with a new kernel cache: the first run compiles its kernels, the second run loads them. Python's
bytecode exists already, as after `pip install`. Times are processor times of the command and its workers. `--only`
selects commands with NAME in their title.
"""

from __future__ import annotations

import compileall
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

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


def main(only: str = "") -> None:
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


def user_seconds(words: list[str], folder: str) -> float:
    """Return the processor time [s] of a command that runs in `folder`, which has the kernel cache."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    command = [sys.executable, "-m", "slamgauge", *words]
    env = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "NUMBA_CACHE_DIR": str(Path(folder, "kernels"))}
    subprocess.run(command, cwd=folder, env=env, check=False, capture_output=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
