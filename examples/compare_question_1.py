"""Question 1 of the practical: how good a filter gets on a short dense, a long dense and a long sparse map.

Dead reckoning, the textbook EKF and the right-invariant EKF run next to the causal optimum (causal) and the
hindsight optimum (batch) on the same measurements. Prints a table for each map and saves the three maps:

    python compare_question_1.py [--seed 0] [--out results/question-1]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from slamgauge import compare_estimators, load_estimators, load_scenario, plot_run, simulate
from slamgauge.compare.scoring.comparison import table

SCENARIOS = ("q1-short-dense", "q1-long-dense", "q1-long-sparse")
ESTIMATORS = ("dead-reckoning", "ekf", "riekf", "causal", "batch")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/question-1"))
    options = parser.parse_args()

    figure = Figure(figsize=(15, 7), layout="constrained")
    for ax, name in zip(figure.subplots(1, 3), SCENARIOS, strict=True):
        truth, recording = simulate(load_scenario(name), options.seed)
        comparison = compare_estimators(truth, recording, load_estimators(ESTIMATORS))
        print(f"{name}, seed {options.seed}\n{table(comparison)}\n")
        plot_run(ax, truth, recording, comparison.estimates)
        ax.set_title(name)

    options.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out / "maps.png", dpi=150)
    print(f"maps: {options.out / 'maps.png'}")


if __name__ == "__main__":
    main()
