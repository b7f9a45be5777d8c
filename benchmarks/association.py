"""Association without ids against known association: one table over Monte Carlo runs.

    python benchmarks/association.py [--runs 50] [--seed 0] [--jobs 2] [--filter riekf] [--scenarios NAME,…]
        [--out results/association]

Wrong and rejected associations in per cent of the observations, the share of runs whose map has as many landmarks
as were there to be seen, ATE, and mean ATE over that with known association on the same measurements.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from slamgauge import load_runs, load_scenario, local_processes, run_study

SCENARIOS = ("q2-short-dense", "q2-long-dense", "q2-long-sparse")
METHODS = {
    "known": ["association.method=known"],
    "nearest neighbour": [],
    "nearest neighbour, managed": ["association.map_management=true"],
    "jcbb, bare": ["association.method=jcbb", "association.map_management=false"],
    "jcbb": ["association.method=jcbb"],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--filter", default="riekf")
    parser.add_argument("--scenarios", default=",".join(SCENARIOS))
    parser.add_argument("--out", type=Path, default=Path("results/association"))
    options = parser.parse_args()
    titles = ("wrong %", "rejected %", "right map %", "mapped", "ATE [m]", "x known")
    print(f"{'':44}" + "".join(f"{title:>13}" for title in titles))
    with local_processes(options.jobs) as executor:
        for name in options.scenarios.split(","):
            known = float("nan")
            for method, overrides in METHODS.items():
                scenario = load_scenario(name, ["start=sampled", *overrides])
                study = (scenario, options.runs, options.seed, [options.filter], options.out / name / method)
                run_study(*study, executor)
                figures = load_runs(*study)[options.filter].figures
                ate, observations = figures["ate_m"].mean(), figures["observations"].sum()
                known = ate if method == "known" else known
                cells = (
                    f"{100 * figures['wrong_associations'].sum() / observations:.4f}",
                    f"{100 * figures['observations_rejected'].sum() / observations:.2f}",
                    f"{100 * (figures['landmarks_mapped'] == figures['landmarks_true']).mean():.0f}",
                    f"{figures['landmarks_mapped'].mean():.1f}",
                    f"{ate:.4f}",
                    f"{ate / known:.4f}",
                )
                print(f"{name + ', ' + method:44}" + "".join(f"{cell:>13}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
