"""What the study engine costs: runs per second of a bare loop, of one worker and of two; then 1000 stored runs.

    python benchmarks/study_throughput.py [--runs 200] [--many 1000]

`q1-long-dense` with `ekf` and `riekf`. The bare loop simulates and calls the estimators, and does nothing else.
Workers are started before the clock.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from slamgauge.compare.studies.executors import local_processes, pin_blas_threads

pin_blas_threads()

from slamgauge import load_estimators, load_scenario, simulate
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.study_run import run_once, run_seed

NAMES = ("ekf", "riekf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--many", type=int, default=1000)
    options = parser.parse_args()
    scenario = load_scenario("q1-long-dense", ["start=sampled"])
    estimators = load_estimators(NAMES)
    run_once(scenario, 0, NAMES)
    start = perf_counter()
    for run in range(options.runs):
        _, recording = simulate(scenario, run_seed(0, run))
        for estimator in estimators.values():
            estimator(recording)
    bare = perf_counter() - start
    print(f"bare loop: {options.runs / bare:.1f} runs/s")
    one = engine(scenario, options.runs, jobs=1)
    print(f"one job: {options.runs / one:.1f} runs/s, {one / bare - 1:+.1%} over the bare loop")
    two = engine(scenario, options.runs, jobs=2)
    print(f"two jobs: {options.runs / two:.1f} runs/s, {one / two:.2f} x one job")
    with TemporaryDirectory() as folder:
        start = perf_counter()
        with local_processes(2) as executor:
            run_study(scenario, options.many, 1, NAMES, Path(folder), executor)
        print(f"{options.many} runs stored by two jobs, start and summary included: {perf_counter() - start:.1f} s")


def engine(scenario: Scenario, runs: int, jobs: int) -> float:
    """Seconds for a study, its workers warm."""
    with TemporaryDirectory() as folder, local_processes(jobs) as executor:
        for warm in [executor.submit(run_once, scenario, seed, NAMES) for seed in range(4 * jobs)]:
            warm.result()
        start = perf_counter()
        run_study(scenario, runs, 0, NAMES, Path(folder), executor)
        return perf_counter() - start


if __name__ == "__main__":
    main()
