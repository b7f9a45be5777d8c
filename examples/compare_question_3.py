"""Question 3 of the practical: a filter that assumes 0.1, 1, 2 and 10 times the true noise (covariances).

Large loop, sparse map, nearest neighbour at gate 9. The causal optimum (causal) is told the true noise and the true
associations. Prints a table for each assumption and saves the errors of the EKF inside the bounds that it reports:

    python compare_question_3.py [--seed 0] [--out results/question-3]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from slamgauge import compare_estimators, informed, load_estimators, load_scenario, simulate
from slamgauge.compare.scoring.comparison import table

SCENARIOS = ("q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10")
ESTIMATORS = ("ekf", "riekf", "causal")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/question-3"))
    options = parser.parse_args()

    figure = Figure(figsize=(12, 4), layout="constrained")
    for ax, name in zip(figure.subplots(1, 4, sharey=True), SCENARIOS, strict=True):
        scenario = load_scenario(name)
        truth, recording = simulate(scenario, options.seed)
        told = simulate(informed(scenario), options.seed)[1]
        estimators = load_estimators(ESTIMATORS, association=scenario.association)
        comparison = compare_estimators(truth, recording, estimators, told)
        print(f"{name}, seed {options.seed}\n{table(comparison)}\n")
        for style, each in (("-", "ekf"), (":", "causal")):
            estimate = comparison.estimates[each]
            assert truth.poses is not None and estimate.pose_covs is not None
            error = np.linalg.norm((estimate.poses - truth.poses)[:, :2], axis=1)
            bound = 3 * np.sqrt(np.trace(estimate.pose_covs[:, :2, :2], axis1=1, axis2=2))
            ax.plot(recording.stamps, error, "k" + style, linewidth=1, label=f"{each}: error")
            ax.plot(recording.stamps, bound, "C0" + style, linewidth=1, label=rf"{each}: 3$\sigma$")
        ax.set(title=f"assumed noise x {scenario.assumed.scale:g}", xlabel="time [s]")
    figure.axes[0].set_ylabel("position error and its bound [m]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)

    options.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out / "errors.png", dpi=150)
    print(f"errors: {options.out / 'errors.png'}")


if __name__ == "__main__":
    main()
