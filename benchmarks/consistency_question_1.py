"""Consistency on question 1 over many seeds, the start drawn from the prior: one table.

    python benchmarks/consistency_question_1.py [--scenario q1-long-dense] [--runs 50] [--band 0.999]

For each estimator: mean ATE with its standard error, its ratio to iSAM2's, mean pose NEES (3 when
consistent), and the share of steps whose mean NEES over the runs lies in the two-sided chi-square band.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from tqdm import tqdm

from compare import load_estimators, load_scenario, simulate
from compare.consistency import chi2_band
from compare.scores import evaluate
from slam2d import Float

NAMES = ("ekf", "riekf", "isam2")


def one_run(scenario_name: str, seed: int) -> dict[str, tuple[float, Float, float]]:
    """ATE [m], NEES of each step and NIS per degree of freedom of each estimator."""
    truth, recording = simulate(load_scenario(scenario_name, ["start=sampled"]), seed)
    results = {}
    for name, estimator in load_estimators(NAMES).items():
        score = evaluate(truth, recording, estimator(recording))
        results[name] = (score.ate_m, score.nees, score.nis_per_dof or np.nan)
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="q1-long-dense")
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--band", type=float, default=0.999)
    options = parser.parse_args()
    seeds = range(options.runs)
    with ProcessPoolExecutor() as pool:
        runs = list(tqdm(pool.map(one_run, [options.scenario] * options.runs, seeds), total=options.runs, disable=None))
    low, high = (bound / options.runs for bound in chi2_band(options.band, 3 * options.runs))
    print(f"{options.scenario}, {options.runs} runs; mean pose NEES at {options.band:.1%}: {low:.2f} to {high:.2f}")
    print(f"{'estimator':10} {'ATE [m]':>15} {'x isam2':>8} {'mean NEES':>10} {'steps in band':>14} {'NIS/dof':>8}")
    optimal = np.mean([run["isam2"][0] for run in runs])
    for name in NAMES:
        ates = np.array([run[name][0] for run in runs])
        nees = np.mean([run[name][1] for run in runs], axis=0)
        inside = np.mean((nees >= low) & (nees <= high))
        nis = np.mean([run[name][2] for run in runs])
        error = ates.std(ddof=1) / np.sqrt(len(ates))
        print(
            f"{name:10} {ates.mean():8.4f} ± {error:.4f} {ates.mean() / optimal:8.3f} {nees.mean():10.2f} "
            f"{inside:14.1%} {'-' if np.isnan(nis) else f'{nis:.3f}':>8}"
        )


if __name__ == "__main__":
    main()
