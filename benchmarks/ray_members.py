"""Where the members of a ray should lie: the right-invariant filter with other rays, over several maps.

    python benchmarks/ray_members.py [--maps ring,three,dense,random,wide] [--roots 0-9] [--runs 5] [--jobs 2]

Of each map and choice of alpha (a member's sigma over its distance), beta (from member to member) and s_min (over the
sensor's reach) the RMS of the ATE over all runs [m] and the median NEES / 3, and over the maps the mean ratio of that
ATE to the least of its map; N is the number of members. `--roots 100` reports on runs that nothing was chosen on.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import local_processes, pin_blas_threads

pin_blas_threads()

import argparse
from typing import NamedTuple

import numpy as np

from slamgauge import Rays, Scenario, evaluate, load_scenario, simulate
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.ekf.estimators import riekf

CHOICES = [
    (0.4, 2.5, 0.1),
    (0.3, 2.0, 0.1),
    (0.3, 2.0, 0.2),
    (0.3, 2.0, 0.3),
    (0.3, 1.8, 0.3),
    (0.25, 1.7, 0.2),
    (0.25, 1.7, 0.3),
    (0.25, 1.7, 0.4),
    (0.2, 1.5, 0.1),
    (0.2, 1.5, 0.2),
    (0.2, 1.5, 0.3),
    (0.2, 1.5, 0.4),
    (0.15, 1.35, 0.3),
]


class Found(NamedTuple):
    """Of one run."""

    ate: float
    nees: float


def scenario_of(name: str) -> Scenario:
    """A map on which rays are tried, its start drawn from the prior."""
    if name in ("ring", "three"):
        return load_scenario({"ring": "q4-ring", "three": "q4-three-landmarks"}[name], ["start=sampled"])
    scattered = load_scenario("q1-long-dense").landmarks.all().tolist()
    if name == "random":
        scattered = np.random.default_rng(4).uniform([-15.0, -5.0], [15.0, 25.0], (40, 2)).round(1).tolist()
    if name == "wide":
        scattered = np.random.default_rng(5).uniform([-30.0, -20.0], [30.0, 40.0], (40, 2)).round(1).tolist()
    reach = 20.0 if name == "wide" else 10.0
    return load_scenario("q4-ring", ["start=sampled", f"landmarks.positions={scattered}", f"sensor.max_range={reach}"])


def rays(alpha: float, beta: float, share: float, reach: float) -> Rays:
    """The rays of a choice, for a sensor of that reach [m]."""
    return Rays(alpha, beta, share * reach, reach)


def carry_out(name: str, seed: int) -> list[Found]:
    """Every choice on one run."""
    scenario = scenario_of(name)
    truth, recording = simulate(scenario, seed)
    found: list[Found] = []
    for choice in CHOICES:
        score = evaluate(truth, recording, riekf(recording, initialisation=rays(*choice, scenario.sensor.max_range)))
        assert score.ate_m is not None
        assert score.nees_pose is not None
        found.append(Found(score.ate_m, score.nees_pose / 3.0))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", default="ring,three,dense,random,wide")
    parser.add_argument("--roots", default="0-9")
    parser.add_argument("--runs", type=int, default=5, help="of each root")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    first, _, last = options.roots.partition("-")
    seeds = [run_seed(root, run) for root in range(int(first), int(last or first) + 1) for run in range(options.runs)]
    maps, ate = options.maps.split(","), {}
    print(f"{'map':8} {'alpha':>6} {'beta':>5} {'s_min':>6} {'N':>3} {'ATE [m]':>9} {'median':>8} {'NEES/3':>8}")
    with local_processes(options.jobs) as executor:
        for name in maps:
            figures = np.array(list(executor.map(carry_out, [name] * len(seeds), seeds)))
            ate[name] = np.sqrt((figures[:, :, 0] ** 2).mean(axis=0))
            medians = np.median(figures, axis=0)
            for choice, of_choice, median in zip(CHOICES, ate[name], medians, strict=True):
                print(f"{name:8} {row(choice)} {of_choice:9.3f} {median[0]:8.3f} {median[1]:8.2f}", flush=True)
    over = np.mean([each / each.min() for each in ate.values()], axis=0)
    print(f"\n{'over maps':8} {'ATE over the least':>40}")
    for choice, ratio in zip(CHOICES, over, strict=True):
        print(f"{'':8} {row(choice)} {ratio:9.3f}")


def row(choice: tuple[float, float, float]) -> str:
    """The settings, and how many members they make."""
    alpha, beta, share = choice
    return f"{alpha:6.2f} {beta:5.2f} {share:6.2f} {rays(*choice, reach=1.0).member_count:3}"


if __name__ == "__main__":
    main()
