"""EKF-SLAM next to GTSAM batch on the same measurements: `python examples/exercise.py q1-long-dense`.

Prints the errors of ten runs, tests them against bounds, and draws the last run into exercise.png. `slamgauge exercise`
does this for every setting of the exercise.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib import pyplot as plt

from slamgauge import assert_error_bounds, ekf_slam, evaluate, gtsam_batch, plot_run, simulate

RUNS = 10


def main(scenario: str) -> None:
    """Compare both estimators in independent runs of a scenario with known association."""
    scores = {"ekf": [], "gtsam-batch": []}
    for seed in range(RUNS):
        truth, recording = simulate(scenario, seed)
        estimates = {"ekf": ekf_slam(recording), "gtsam-batch": gtsam_batch(recording)}
        for name, estimate in estimates.items():
            scores[name].append(evaluate(truth, recording, estimate))
    for name, found in scores.items():
        ate, nees = (np.mean([getattr(score, key) for score in found]) for key in ("ate_m", "nees_pose"))
        print(f"{name:12} RMS position error {ate:.3f} m, NEES/3 {nees / 3:.2f} (1 is ideal)")
    best = float(np.mean([score.ate_m for score in scores["gtsam-batch"]]))
    assert_error_bounds(scores["gtsam-batch"], nees_level=0.999)  # two-sided: it is neither overconfident nor cautious
    assert_error_bounds(scores["ekf"], max_ate_m=4.0 * best)
    figure, ax = plt.subplots(figsize=(6, 6))
    plot_run(ax, truth, recording, estimates)
    figure.savefig("exercise.png", bbox_inches="tight")


if __name__ == "__main__":
    main(*sys.argv[1:])
