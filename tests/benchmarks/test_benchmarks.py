"""The benchmarks: each, at its smallest size, ends well and prints its table; none is forgotten.

CPU seconds of each on one core, with compiled kernels, stand beside it; about 115 for all.
"""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slamgauge.ekf.kernels.warm_up import compile_association_once, compile_once, compile_sights_once
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
    "association": (  # 5 s
        "--runs 1 --jobs 1 --scenarios q2-short-dense --out results",
        "wrong % rejected % right map % mapped ATE [m] x known",
        "q2-short-dense, jcbb 0.0",
    ),
    "association_times": ("--landmarks 20 --observations 3", "landmarks jcbb compatibility update", "20 "),  # 2 s
    "bearing_optimum": (  # 4 s
        "--scenario q4-three-landmarks --runs 1 --jobs 1",
        "start failed lower equal higher lowest, relative to batch",
        "truth 0 0 1 0 ",
    ),
    "chart_libraries": ("", "library bytes complaints start [ms]", "slamgauge "),  # 5 s
    "class_of_thirty": (  # 15 s
        "--graded 2 --runs 2 --scenario q1-short-dense --timeout 8 --jobs 1",
        "submission verdict ATE [m] x ekf",
        "(ekf) reference ",
        "2 graded, 6 named with their reasons",
    ),
    "best_association": ("--runs 1 --sigmas 5", "sigma [deg] bearings wrong %", "5 "),
    "bound": (  # 3 s
        "--scenarios stationary --runs 2 --jobs 1",
        "scenario bound expected hindsight expected riekf causal batch",
        "stationary 0.",
    ),
    "claims_power": (  # 2 s
        "--claims q3-scale-10-error --roots 1 --runs 3 --studies 20 --most 100 --jobs 1",
        "claim over runs x end decidable decided % after wrong %",
        "q3-scale-10-error q3-scale-1 3 ",
    ),
    "close_landmarks": ("--runs 2 --distances 1.0 --jobs 1", "distance [m] ekf: ATE NEES/3 lost", "1.0 "),  # 3 s
    "causal_optimum": ("--landmarks 20 --steps 60 --prefixes 5 --log 2000", "estimator landmarks", "causal 20 60 "),
    "compiled_peer": (  # 10 s, most of it its compilation
        "--landmarks 20",
        "landmarks ours [ms] p95 other [ms] p95 ours/other difference",
        "20 0.0",
    ),
    "compressed_memory": ("--landmarks 160", "landmarks P [GB] beyond [GB] drive [s] longest [s]", "160 0.001 "),  # 3 s
    "faults": (  # 10 s
        "--faults limit,read-only,foreign --commands export --foreign 40 --kills 1",
        "fault command tried done refused traceback hang crash lost",
        "limit export 2 1 1 0 0 0 0",
        "foreign export 2 2 0 0 0 0 0",
        "tracebacks, hangs, crashes and losses: 0",
    ),
    "kill_a_study": ("--runs 4 --kills 1", "killed with", "the same summary after 1 kills; 4 runs"),
    "fixed_lag": (  # 4 s
        "--scenario q4-three-landmarks --lags 2 --runs 1 --jobs 1",
        "estimator RMSE [m] x bound NEES/3 mapped step [ms] failed",
        "riekf ",
        "fixed-lag-2 ",
        "sliding-window-2 ",
    ),
    "fuzz": (  # 15 s
        "--cases 400 --seed 0",
        "input tried refused in one line accepted traceback hang crash silently altered",
        "recording npz ",
        "arguments ",
        "all 400 ",
    ),
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
    "memory_traffic": ("--landmarks 20", "landmarks k MB moved of it P at bandwidth", "20 12 "),  # 2 s
    "noise_intervals": (  # 10 s
        "--recordings 2 --outliers 1 --duration 15 --seed 3 --jobs 1",
        "recordings sigma number held too low too high median interval",
        "q1-short-dense range 1 ",
        "both bearing 2 ",
        "seconds a recording, with outliers: median ",
    ),
    "noise_lasting": (  # 6 s
        "--recordings 1",
        "correlations count as one simulated: ATE [m] NEES found: ATE [m] NEES written: ATE [m] NEES",
        "0.9 0.9 ",
        "0.0 0.0 1.00 ",
    ),
    "optimum_times": ("--landmarks 20 --marginals 20", "landmarks build optimise build/opt. finish", "20 "),  # 2 s
    "posterior_mean": (  # 3 s
        "--scenario q4-three-landmarks --steps 30 --runs 2 --samples 20 --jobs 1",
        "scenario step runs maximum [m] mean [m] mean / maximum apart unsure accepted",
        "q4-three-landmarks 30 2 ",
    ),
    "ray_members": (  # 3 s
        "--maps three --roots 0 --runs 1 --jobs 1",
        "map alpha beta s_min N ATE [m] median NEES/3",
        "three 0.40 2.50 0.10 3 ",
        "over maps ATE over the least",
    ),
    "scale_of_bearings": (  # 4 s
        "--runs 2 --steps 300 --scenario q4-three-landmarks",
        "noise of speed in estimator size % scatter % equal after steps",
        "0.3 m/s, odometry ekf inverse-depth ",
        "0.3 m/s, path batch ",
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
    "study_throughput": ("--runs 2 --many 2", "bare loop:", "2 runs stored by two jobs"),  # 10 s
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
    compile_sights_once()
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


@pytest.mark.gtsam
def test_an_indeterminate_system_is_a_row():
    """GTSAM's `Marginals` refuses some constrained systems; that is a figure of the table, not the end of it."""
    import gtsam

    marginals_time = runpy.run_path(str(BENCHMARKS / "optimum_times.py"))["marginals_time"]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    step = gtsam.Pose2(1.0, 0.0, 0.0)
    for key in (0, 1):
        values.insert(key, gtsam.Pose2())
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.ones(3))
    graph.add(gtsam.BetweenFactorPose2(0, 1, step, noise))  # nothing says where in the world
    assert marginals_time(graph, values) == "indeterminate"
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), noise))
    assert float(marginals_time(graph, values)) < 1.0
    with pytest.raises(RuntimeError, match="key"):
        marginals_time(graph, gtsam.Values())
