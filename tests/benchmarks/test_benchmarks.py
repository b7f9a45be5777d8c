"""Every benchmark runs at its smallest size and prints its table.

Comments give CPU seconds on one core with compiled kernels.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.kernels import compile_kernels
from tests.marks import in_full

pytestmark = pytest.mark.slow

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

# arguments, and the beginnings of printed lines in their order; spaces stand for any white space
SMALLEST = {
    "agreement": (  # 4 s
        "--recordings 2 --seed 1 --jobs 1",
        "estimator agrees worse failed undecided not compared largest difference",
        "riekf ",
        "causal steps:",
    ),
    "consistency_test": (  # 4 s
        "--runs 1 --twins 3 --set trajectory.duration=2 --estimators riekf --q 1,1.5",
        "estimator tested sigmas consistent overconfident too cautious",
        "riekf 1 ",
        "riekf, true Q 1.5 times as large 1 ",
    ),
    "exercise_verdicts": (  # 10 s
        "exercise --only q3 --runs 2 --studies 5",
        "5 studies from 2 runs; wrong and decided share with 10, 20, 50, 100 runs",
        "q3-scale-0.1-landmarks 3.1 wrong ",
        "sum wrong ",
    ),
    "literature": (  # 6 s
        "--runs 2 --only zhang2017-stationary --jobs 1",
        "claim ratio interval verdict hypothesis",
        "zhang2017-stationary 1 1 to 1 holds last heading sigma of riekf@stationary / of causal in 0.909 to 1.1",
        "with 95% probability the intervals of all 19 claims contain the true ratios",
        "zhang2017: Zhang, Wu,",
    ),
    "misfits": ("", "log chi2/dof batch causal", "1% ids swapped ", "noise 3 times too small "),  # 30 s
    "published_ukfm": (
        "--runs 2 --jobs 1",
        "heading RMSE [deg] position RMSE [m]",
        "EKF, published 3.02 ",
        "causal ",
    ),  # 8 s
    "seeded_bugs": (  # 20 s
        "--seeds 1",
        "bug named check caught other checks that fail",
        "(none) - - -",
        "wrong sign in F prediction-jacobian 1/1 - ",
    ),
    "import_causes": (  # 10 s
        "--seeds 1",
        "1 logs for each mistake and noise",
        "none 100% 0% 0% 100% 0% 0% 100% 0% 0%",
        "ranges are in mm 100% 0% 0%",
    ),
    "verdict_power": (  # 3 s
        "--trials 20",
        "20 trials",
        "errors / sigmas runs share of verdicts",
        "1.5 100 too small a sigma 100.0%",
        "NIS / dof runs share of verdicts",
        "1.2 100 innovations larger than it expects 100.0%",
    ),
}


@pytest.fixture(scope="module")
def compiled_kernels() -> None:
    """Compile before benchmarks that run at the same time would each do so."""
    compile_kernels()


def test_every_benchmark_is_run_here():
    assert {*SMALLEST} == {path.stem for path in BENCHMARKS.glob("*.py")}


LONG = ("misfits", "import_causes", "seeded_bugs", "published_ukfm")  # other tests have causes, bugs and the scenario


@pytest.mark.usefixtures("compiled_kernels")
@pytest.mark.parametrize("name", [*(name for name in SMALLEST if name not in LONG), *in_full(LONG)])
def test_a_benchmark_prints_its_table(name: str, tmp_path: Path):
    arguments, *expected = SMALLEST[name]
    command = [sys.executable, BENCHMARKS / f"{name}.py", *arguments.split()]
    env = {**os.environ, "PYTHONSAFEPATH": "1"}  # as in the processes that studies start
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr
    lines = [re.sub(r"\s+", " ", line).strip() + " " for line in done.stdout.splitlines()]
    found = [next((i for i, line in enumerate(lines) if line.startswith(words)), -1) for words in expected]
    assert -1 not in found, done.stdout
    assert found == sorted(found)


@pytest.mark.parametrize("name", SMALLEST)
def test_the_usage_in_a_docstring_has_all_options_of_a_benchmark(name: str):
    source = (BENCHMARKS / f"{name}.py").read_text(encoding="utf-8")
    (main,) = (each for each in ast.parse(source).body if isinstance(each, ast.FunctionDef) and each.name == "main")
    usage = source.split("\n\n")[1]
    assert f"python benchmarks/{name}.py" in usage
    assert {*re.findall(r"--[a-z]+", usage)} == {f"--{argument.arg}" for argument in main.args.args}
    assert "tyro.cli(main, description=__doc__)" in source  # `--help` prints the docstring
