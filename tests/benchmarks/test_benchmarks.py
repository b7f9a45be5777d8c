"""Every benchmark runs at its smallest size and prints its table.

Comments give CPU seconds on one core with compiled kernels; all need about 90 s.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.ekf.kernels.warm_up import compile_association_once, compile_numpy_filters_once, compile_once
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

# arguments, and how a line of what it prints begins and goes on: words, with any space between them
SMALLEST = {
    "agreement": (  # 25 s
        "--recordings 20 --seed 1 --jobs 1",
        "estimator agrees worse failed undecided not compared largest difference",
        "riekf ",
        "causal steps:",
        "bars missed:",
    ),
    "fuzz": (  # 15 s
        "--cases 400 --seed 0",
        "input tried refused in one line accepted traceback hang crash silently altered",
        "recording npz ",
        "arguments ",
        "all 400 ",
    ),
    "compile_times": ("--only=--version", "command first [s] kernels again [s]", "--version "),
    "large_maps": (  # 2 s
        "--landmarks 20",
        "landmarks filter median [ms] mean [ms] p95 [ms] worst [ms] difference memory/P",
        "20 compressed ",
    ),
    "large_optima": (  # 7 s
        "--landmarks 20,40",
        "landmarks scans seen batch [s] one [s] pieces front memory [GB] chi2/dof",
        "20 ",
        "from 20 to 37: batch landmarks^",
    ),
    "seeded_bugs": (  # 5 s
        "--seeds 1",
        "bug named law caught others that it breaks",
        "(none) - - -",
        "wrong sign in F prediction-jacobian 1/1 ",
    ),
    "soak": (  # 6 s
        "--steps 200 --only riekf",
        "filter us/step map eigenv. asymmetr. size % MB grown ..10% ..20%",
        "riekf ranges ids ",
        "riekf ranges nearest-neighbour ",
        "riekf ranges managed neighbour ",
        "riekf bearings delayed ",
        "riekf bearings fis jcbb ",
    ),
    "ukfm_slam2d": (  # 14 s
        "--runs 1 --jobs 1 --out results",
        "heading RMSE [deg] position RMSE [m] NEES heading NEES position last sigma / causal",
        "riekf - - - - 0.9",
    ),
}


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    """The benchmarks may run at the same time, and would each compile them."""
    compile_once()
    compile_association_once()
    compile_numpy_filters_once()
    compile_graphs_once()


def test_every_benchmark_is_run_here():
    assert {*SMALLEST} == {path.stem for path in BENCHMARKS.glob("*.py")}


@pytest.mark.parametrize("name", SMALLEST)
def test_a_benchmark_prints_its_table(name: str, tmp_path: Path):
    arguments, *expected = SMALLEST[name]
    command = [sys.executable, BENCHMARKS / f"{name}.py", *arguments.split()]
    env = {**os.environ, "PYTHONSAFEPATH": "1"}  # as studies set it for what they start
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr
    lines = [re.sub(r"\s+", " ", line).strip() + " " for line in done.stdout.splitlines()]
    found = [next((i for i, line in enumerate(lines) if line.startswith(words)), -1) for words in expected]
    assert -1 not in found, done.stdout
    assert found == sorted(found)  # the title above what it stands for


@pytest.mark.parametrize("name", SMALLEST)
def test_a_benchmark_tells_its_options(name: str):
    """The command in its docstring names every option that it has, and `--help` prints that docstring."""
    source = (BENCHMARKS / f"{name}.py").read_text(encoding="utf-8")
    has = {*re.findall(r'add_argument\("(--[a-z]+)"', source)}
    docstring = source.split('"""')[1]
    usage = docstring.split("\n\n")[1]
    assert f"python benchmarks/{name}.py" in usage
    assert {*re.findall(r"--[a-z]+", usage)} == has
