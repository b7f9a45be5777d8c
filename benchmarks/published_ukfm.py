"""Do the filters have the figures that UKF-M's 2D SLAM example publishes (docs/consistency.md)?

    python benchmarks/published_ukfm.py [--runs 100] [--seed 0] [--jobs 2] [--out results/ukfm-slam2d]

The study in the folder is continued. The published figures are means of 100 other runs.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import tyro

from slamgauge.compare.scoring.intervals import Interval, mean_interval
from slamgauge.compare.scoring.runs import Runs, late_means
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study import run_study

FILTERS = ("ekf", "fej-ekf", "iekf", "riekf", "causal")
DEGREE = math.radians(1.0)
FIGURES: dict[str, tuple[Callable[[Runs], Interval | None], float]] = {  # with the unit
    "heading RMSE [deg]": (lambda runs: runs.heading_rmse({}), DEGREE),
    "position RMSE [m]": (lambda runs: runs.position_rmse_m({}), 1.0),
    "NEES heading": (lambda runs: mean_interval(late_means(runs.series["nees_heading"])), 1.0),
    "NEES position": (lambda runs: mean_interval(late_means(runs.series["nees_position"] / 2)), 1.0),
}
PUBLISHED = {
    "EKF, published": (3.02, 0.67, 2.88, 2.56),
    "right-UKF, published": (2.51, 0.55, 1.01, 1.09),
    "IEKF, published": (2.51, 0.55, 1.01, 1.17),
}


def main(runs: int = 100, seed: int = 0, jobs: int = 2, out: Path = Path("results/ukfm-slam2d")) -> int:
    with local_processes(jobs) as executor:
        summary = run_study("ukfm-slam2d", runs, seed, FILTERS, out, executor)
    print(f"{'':22}" + "".join(f"{title:>20}" for title in FIGURES))
    for name, figures in PUBLISHED.items():
        print(f"{name:22}" + "".join(f"{figure:20.2f}" for figure in figures))
    for name in FILTERS:
        found = [_text(figure(summary.loaded[name]), unit) for figure, unit in FIGURES.values()]
        print(f"{name:22}" + "".join(f"{text:>20}" for text in found))
    return 0


def _text(interval: Interval | None, unit: float) -> str:
    """Return a mean with half of its 95 % interval."""
    assert interval is not None and interval.low is not None and interval.high is not None  # there are several runs
    return f"{interval.mean / unit:.3f} ± {(interval.high - interval.low) / 2 / unit:.3f}"


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
