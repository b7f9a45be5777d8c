"""What a longer lag buys: the fixed-lag smoother and the sliding-window filter beside the optimum.

    python benchmarks/fixed_lag.py [--scenario q1-short-dense] [--duration 20] [--lags 1,2,5,10,20,50,200] [--runs 10]
                                   [--seed 100] [--jobs 2] [--smoothers fixed-lag,sliding-window]

`riekf` has no lag. Over runs: RMS position error [m], that over the Cramer-Rao bound with its 95 % interval, pose NEES
over 3, landmarks in the map, and milliseconds of a step in the mean (one core).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from slamgauge import load_runs, load_scenario, run_study
from slamgauge.compare.studies.executors import local_processes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="q1-short-dense")
    parser.add_argument("--lags", default="1,2,5,10,20,50,200")
    parser.add_argument("--duration", default="", help="[s], if not the scenario's own")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--smoothers", default="fixed-lag,sliding-window")
    options = parser.parse_args()
    shorter = [f"trajectory.duration={options.duration}"] if options.duration else []
    scenario = load_scenario(options.scenario, ["start=sampled", *shorter])
    lagging = [f"{smoother}-{lag}" for smoother in options.smoothers.split(",") for lag in options.lags.split(",")]
    shown = ["riekf", *lagging, "causal"]
    names = [*shown, "bound"]
    with TemporaryDirectory() as folder, local_processes(options.jobs) as executor:
        summary = run_study(scenario, options.runs, options.seed, names, Path(folder), executor)
        runs = load_runs(scenario, options.runs, options.seed, names, Path(folder))
    print(f"{'estimator':20}{'RMSE [m]':>9}{'x bound':>16}{'NEES/3':>8}{'mapped':>8}{'step [ms]':>11}{'failed':>8}")
    for name in shown:
        entry = summary.estimators[name]
        if entry.ate_m is None or entry.ratio_to_bound is None or entry.seconds_total is None:
            print(f"{name:20}{'-':>9}{'-':>16}{'-':>8}{'-':>8}{'-':>11}{options.runs - entry.runs:8}", flush=True)
            continue
        steps = runs[name].series["error_x"].shape[1]
        mean, low, _ = entry.ratio_to_bound
        figures = f"{entry.position_rmse_m.mean:9.3f}" if entry.position_rmse_m else f"{'-':>9}"
        figures += f"{mean:8.3f} ± {mean - (low or mean):.3f}"
        nees, mapped = entry.nees_pose_per_dof, entry.landmarks_mapped
        figures += "".join(f"{each.mean:8.2f}" if each else f"{'-':>8}" for each in (nees, mapped))
        print(f"{name:20}{figures}{1e3 * entry.seconds_total / steps:11.2f}{options.runs - entry.runs:8}", flush=True)
    for failure in summary.failures:
        print(f"run {failure.run}: {failure.estimator}: {failure.error}")


if __name__ == "__main__":
    main()
