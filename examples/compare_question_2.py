"""Question 2 of the practical: unknown data association, by the nearest landmark within a gate of 1, 9 or 100.

The textbook EKF and the right-invariant EKF find the associations themselves. The causal optimum (causal) is told
the true ones, and causal@ekf is the same optimum under the associations that the EKF has made: what it loses, wrong
associations cost. Prints a table for each gate and saves the three maps:

    python compare_question_2.py [--seed 0] [--out results/question-2]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from slamgauge import compare_estimators, load_estimators, load_scenario, plot_run, simulate
from slamgauge.compare.scoring.comparison import table

SCENARIOS = ("q2-gate-1", "q2-long-dense", "q2-gate-100")
ESTIMATORS = ("ekf", "riekf", "causal", "causal@ekf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/question-2"))
    options = parser.parse_args()

    figure = Figure(figsize=(15, 7), layout="constrained")
    for ax, name in zip(figure.subplots(1, 3), SCENARIOS, strict=True):
        scenario = load_scenario(name)
        truth, recording = simulate(scenario, options.seed)
        chosen = ESTIMATORS if scenario.association.gate > 1 else ESTIMATORS[:3]  # 1500 landmarks: minutes
        comparison = compare_estimators(truth, recording, load_estimators(chosen, association=scenario.association))
        print(f"{name}, seed {options.seed}\n{table(comparison)}\n")
        plot_run(ax, truth, recording, {each: comparison.estimates[each] for each in ("ekf", "causal")})
        ax.set_title(
            f"gate {scenario.association.gate:g}: {comparison.scores['ekf'].landmarks_mapped} landmarks mapped"
        )

    options.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out / "maps.png", dpi=150)
    print(f"maps: {options.out / 'maps.png'}")


if __name__ == "__main__":
    main()
