"""Where first-estimates Jacobians fail: landmarks that the robot passes closely; one table.

    python benchmarks/close_landmarks.py [--runs 50] [--distances 0.1,0.3,0.5,1.0] [--jobs 2]

Twenty landmarks on a circle inside the path of `q1-long-dense`, that many metres from it, seen from 10 m.
Mean ATE [m] and mean pose NEES / 3 over the runs that an estimator survives, and how many it does not.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from slamgauge import load_scenario
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study import run_study

NAMES = ("ekf", "fej-ekf", "oc-ekf", "iekf", "riekf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--distances", default="0.1,0.3,0.5,1.0")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    print(f"{'distance [m]':>12}" + "".join(f"{name + ': ATE':>16}{'NEES/3':>9}{'lost':>6}" for name in NAMES))
    for distance in map(float, options.distances.split(",")):
        angle = 0.15 + 2 * np.pi * np.arange(20) / 20
        radius = 10.0 - distance
        positions = np.column_stack([radius * np.sin(angle), 10.0 - radius * np.cos(angle)]).tolist()
        scenario = load_scenario("q1-long-dense", ["start=sampled", f"landmarks.positions={positions}"])
        with TemporaryDirectory() as folder, local_processes(options.jobs) as executor:
            summary = run_study(scenario, options.runs, 0, NAMES, Path(folder), executor)
        line = f"{distance:12.1f}"
        for entry in summary.estimators.values():
            ate, nees = entry.ate_m, entry.nees_pose_per_dof
            figures = "-" if ate is None else f"{ate.mean:.3f}", "-" if nees is None else f"{nees.mean:.2f}"
            line += f"{figures[0]:>16}{figures[1]:>9}{options.runs - entry.runs:6}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
