"""Questions 1 to 4 of the exercise: estimators on the same measurements, next to the optimum.

1. Short dense, long dense and long sparse map: dead reckoning, the textbook EKF, the right-invariant EKF, the causal
   optimum (causal) and the hindsight optimum (batch).
2. Unknown association by the nearest landmark within a gate of 1, 9 or 100. `causal` has the true associations, and
   causal@ekf is the same optimum with the associations of the EKF: the difference is the cost of wrong associations.
3. Filters that assume 0.1, 1, 2 and 10 times the true noise covariances. `causal` has the true noise and associations.
4. Bearing-only SLAM with three ways to initialise a landmark: FIS rays (the exercise's), inverse depth, delayed.

Prints a table for each scenario of the question and saves a figure: the maps, or for question 3 the errors of the EKF
with the bounds that it reports.

    python compare_questions.py 1 [--seed 0] [--out results/question-1]
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slamgauge import (
    Estimate,
    Recording,
    Scenario,
    Truth,
    compare_estimators,
    informed,
    load_estimators,
    load_scenario,
    plot_run,
    simulate,
)
from slamgauge.compare.scoring.comparison import table
from slamgauge.estimate import Estimator

SCENARIOS = {
    1: ("q1-short-dense", "q1-long-dense", "q1-long-sparse"),
    2: ("q2-gate-1", "q2-long-dense", "q2-gate-100"),
    3: ("q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10"),
    4: ("q4-three-landmarks", "q4-ring"),
}
ESTIMATORS = {
    1: ("dead-reckoning", "ekf", "riekf", "causal", "batch"),
    2: ("ekf", "riekf", "causal", "causal@ekf"),
    3: ("ekf", "riekf", "causal"),
}
BEARING_FILTERS = (("ekf", "fis"), ("riekf", "fis"), ("riekf", "inverse-depth"), ("riekf", "delayed"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("question", type=int, choices=SCENARIOS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    question, out = options.question, options.out or Path(f"results/question-{options.question}")

    figure = Figure(figsize=(15, 5 if question == 3 else 7), layout="constrained")
    names = SCENARIOS[question]
    for ax, name in zip(figure.subplots(1, len(names), sharey=question == 3), names, strict=True):
        scenario = load_scenario(name, [] if question == 4 else ["start=mean"])
        truth, recording = simulate(scenario, options.seed)
        true_noise = simulate(informed(scenario), options.seed)[1] if question == 3 else None
        comparison = compare_estimators(truth, recording, estimators_of(question, scenario), true_noise)
        print(f"{name}, seed {options.seed}\n{table(comparison)}\n")
        if question == 3:
            plot_errors(ax, truth, recording, comparison.estimates)
        else:
            shown = ("ekf", "causal") if question == 2 else comparison.estimates
            plot_run(ax, truth, recording, {each: comparison.estimates[each] for each in shown})
        ax.set_title(name)
    if question == 3:
        figure.axes[0].set_ylabel("position error and its bound [m]")
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "figure.png", dpi=150)
    print(f"figure: {out / 'figure.png'}")


def estimators_of(question: int, scenario: Scenario) -> Mapping[str, Estimator]:
    if question < 4:
        names = ESTIMATORS[question]
        if scenario.name == "q2-gate-1":  # causal@ekf takes minutes with the 1500 landmarks of this gate
            names = names[:3]
        return load_estimators(names, association=scenario.association)
    estimators: dict[str, Estimator] = {}
    for name, initialisation in BEARING_FILTERS:
        settings = load_scenario(scenario.name, [f"initialisation={initialisation}"]).initialisation_settings
        estimators[f"{name}, {initialisation}"] = load_estimators([name], initialisation=settings)[name]
    return estimators | load_estimators(["causal"])


def plot_errors(ax: Axes, truth: Truth, recording: Recording, estimates: Mapping[str, Estimate]) -> None:
    for style, each in (("-", "ekf"), (":", "causal")):
        estimate = estimates[each]
        assert truth.poses is not None and estimate.pose_covs is not None
        error = np.linalg.norm((estimate.poses - truth.poses)[:, :2], axis=1)
        bound = 3 * np.sqrt(np.trace(estimate.pose_covs[:, :2, :2], axis1=1, axis2=2))
        ax.plot(recording.stamps, error, "k" + style, linewidth=1, label=f"{each}: error")
        ax.plot(recording.stamps, bound, "C0" + style, linewidth=1, label=rf"{each}: 3$\sigma$")
    ax.set_xlabel("time [s]")


if __name__ == "__main__":
    main()
