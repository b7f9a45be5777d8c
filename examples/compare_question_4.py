"""Question 4 of the practical: bearings alone, and three ways to begin a landmark, next to the causal optimum.

The right-invariant filter with FIS rays (the practical's), in inverse depth, and with delayed initialisation; the
textbook filter with FIS rays. Prints a table for each scenario and saves the maps:

    python compare_question_4.py [--seed 0] [--out results/question-4]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from slamgauge import compare_estimators, load_estimators, load_scenario, plot_run, simulate
from slamgauge.compare.scoring.comparison import table
from slamgauge.estimate import Estimator

SCENARIOS = ("q4-three-landmarks", "q4-ring")
FILTERS = (("ekf", "fis"), ("riekf", "fis"), ("riekf", "inverse-depth"), ("riekf", "delayed"))


def estimators_for(scenario_name: str) -> dict[str, Estimator]:
    estimators: dict[str, Estimator] = {}
    for name, initialisation in FILTERS:
        settings = load_scenario(scenario_name, [f"initialisation={initialisation}"]).initialisation_settings
        estimators[f"{name}, {initialisation}"] = load_estimators([name], initialisation=settings)[name]
    return estimators | load_estimators(["causal"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/question-4"))
    options = parser.parse_args()

    figure = Figure(figsize=(12, 7), layout="constrained")
    for ax, name in zip(figure.subplots(1, 2), SCENARIOS, strict=True):
        truth, recording = simulate(load_scenario(name, ["start=sampled"]), options.seed)
        comparison = compare_estimators(truth, recording, estimators_for(name))
        print(f"{name}, seed {options.seed}\n{table(comparison)}\n")
        plot_run(ax, truth, recording, comparison.estimates)
        ax.set_title(name)

    options.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out / "maps.png", dpi=150)
    print(f"maps: {options.out / 'maps.png'}")


if __name__ == "__main__":
    main()
