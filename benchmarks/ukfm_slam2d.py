"""Run the 2D SLAM benchmark of UKF-M and print our results next to the published ones.

    python benchmarks/ukfm_slam2d.py [--runs 100] [--seed 0] [--jobs 2] [--out results/ukfm-slam2d]

Our results have 95 % intervals over runs. NEES is per degree of freedom. The published results come from 100 other runs
and have no intervals (Brossard, Barrau and Bonnabel, project ukfm).
"""

from __future__ import annotations

import math
from pathlib import Path

import tyro

from slamgauge import load_scenario
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import MARK, doubt_in_runs
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.summary import share_in_doubt

# orientation RMSE [deg], position RMSE [m], NEES of orientation and of position
PUBLISHED = {"EKF": (3.02, 0.67, 2.88, 2.56), "right-UKF": (2.51, 0.55, 1.01, 1.09), "IEKF": (2.51, 0.55, 1.01, 1.17)}
NAMES = ("ekf", "fej-ekf", "iekf", "riekf", "riukf", "robocentric-ekf", "causal")


def main(runs: int = 100, seed: int = 0, jobs: int = 2, out: Path = Path("results/ukfm-slam2d")) -> None:
    scenario = load_scenario("ukfm-slam2d")
    with local_processes(jobs) as executor:
        summary = run_study(scenario, runs, seed, NAMES, out, executor)
    titles = ("heading RMSE [deg]", "position RMSE [m]", "NEES heading", "NEES position", "last sigma / causal")
    print(f"{'':20}" + "".join(f"{title:>23}" for title in titles))
    for name, figures in PUBLISHED.items():
        print(f"{name + ', published':20}" + "".join(f"{figure:23.2f}" for figure in figures))
    doubt = doubt_in_runs(CAUSAL, share_in_doubt(summary))
    for name, entry in summary.estimators.items():
        cells = [
            cell(entry.heading_rmse_rad, math.degrees(1.0)),
            cell(entry.position_rmse_m),
            cell(entry.nees_heading),
            cell(entry.nees_position_per_dof),
            " ".join("-" if ratio is None else f"{ratio:.3f}" for ratio in entry.sigma_ratio_to_optimum_final or ()),
        ]
        print(f"{name:20}" + "".join(f"{each:>23}" for each in cells) + (MARK if doubt else ""))
    if doubt:
        print(doubt)


def cell(interval: Interval | None, unit: float = 1.0) -> str:
    if interval is None or interval.low is None or interval.high is None:
        return "-"
    return f"{unit * interval.mean:.3f} ± {unit * (interval.high - interval.low) / 2:.3f}"


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
