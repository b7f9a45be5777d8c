"""EKF-SLAM next to GTSAM batch on the same measurements: `python examples/exercise.py [q1-long-dense]`.

Prints the errors of ten runs, tests them against bounds, and draws run 0 into exercise.png. `slamgauge exercise` does
this for every setting of the exercise.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib import pyplot as plt

from slamgauge import Score, assert_error_bounds, ekf_slam, evaluate, gtsam_batch, plot_run, simulate


def main(scenario: str = "q1-long-dense") -> None:
    """Compare both estimators in ten runs of a scenario with known association."""
    scores: dict[str, list[Score]] = {"ekf": [], "gtsam-batch": []}
    for seed in range(10):
        truth, recording = simulate(scenario, seed)
        estimates = {"ekf": ekf_slam(recording), "gtsam-batch": gtsam_batch(recording)}
        for name, estimate in estimates.items():
            scores[name].append(evaluate(truth, recording, estimate))
        if seed == 0:
            figure, ax = plt.subplots(figsize=(6, 6))
            plot_run(ax, truth, recording, estimates)
            figure.savefig("exercise.png", bbox_inches="tight")
    ate = {name: float(np.mean([score["ate_m"] for score in each])) for name, each in scores.items()}
    for name, each in scores.items():
        nees = np.mean([score["nees_pose"] for score in each]) / 3
        print(f"{name:12} RMS position error {ate[name]:.3f} m, NEES/3 {nees:.2f} (1 is ideal)")
    assert_error_bounds(scores["gtsam-batch"], nees_level=0.999)  # two-sided: neither overconfident nor cautious
    assert_error_bounds(scores["ekf"], max_ate_m=4.0 * ate["gtsam-batch"])


if __name__ == "__main__":
    main(*sys.argv[1:])
