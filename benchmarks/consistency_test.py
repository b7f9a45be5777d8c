"""Level and power of the consistency test without ground truth, on simulated recordings.

    python benchmarks/consistency_test.py [--estimators causal,riekf,ekf] [--runs 200] [--twins 499] [--q 1.5]

The start and the noise of every recording are drawn anew. The distribution of a consistent filter comes from `--twins`
other seeds of the scenario, shared by all recordings. With `--own` it comes from `--twins` simulated twins of each
recording, as in `slamgauge evaluate --twins`, which takes much longer. `--q` is the true covariance of the odometry
divided by the one that filters and optimum assume. The estimator `bugs` means all bugs of `references/seeded_bugs.py`
and the same EKF without a bug.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

from references.seeded_bugs import SEEDED, seeded_ekf

from slamgauge import batch, causal, ekf_slam, riekf
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.hausman import ConsistencyTest, consistency_test, consistent_figures, twin_figures
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Filter = Callable[[Recording], Estimate]
FILTERS: dict[str, Filter] = {"causal": causal, "riekf": riekf, "ekf": ekf_slam}
BUGS: dict[str, Filter] = {bug or "no bug": partial(seeded_ekf, bug=bug) for bug in ("", *SEEDED)}
FIRST_TWIN = 100_000  # seed


def main(
    scenario: str = "q1-short-dense",
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = (),
    estimators: str = "causal,riekf,ekf",
    runs: int = 200,
    twins: int = 499,
    own: bool = False,
    q: float = 1.0,
) -> int:
    filters = BUGS if estimators == "bugs" else {name: FILTERS[name] for name in estimators.split(",")}
    changed = ["start=sampled", *set]
    motion = load_scenario(scenario, changed).motion
    true_noise = [f"motion.{key}={np.sqrt(q) * getattr(motion, key)}" for key in ("sigma_speed", "sigma_yaw_rate_deg")]
    drawn = load_scenario(scenario, [*changed, *true_noise])
    shared = None
    if not own:
        assumed = load_scenario(scenario, changed)
        shared = consistent_figures(simulate(assumed, FIRST_TWIN + seed)[1] for seed in range(twins))
    tests: dict[str, list[ConsistencyTest]] = {name: [] for name in filters}
    for seed in range(runs):
        recording = simulate(drawn, seed)[1]
        recording = replace(recording, odometry_cov=recording.odometry_cov / q)
        optimum = batch(recording)
        null = shared or twin_figures(recording, optimum, twins)
        for name, filter_ in filters.items():
            try:
                with np.errstate(all="ignore"):  # bugs may overflow
                    tests[name].append(consistency_test(recording, filter_(recording), optimum, null))
            except (UserError, np.linalg.LinAlgError, ValueError):
                pass  # bugs may raise errors
    print(f"{'estimator':35}{'tested':>7}{'sigmas':>9}{'consistent':>12}{'overconfident':>15}{'too cautious':>14}")
    for name, found in tests.items():
        print_row(name, [each for each in found if np.isfinite(each.ratio)])
    return 0


def print_row(name: str, tests: list[ConsistencyTest]) -> None:
    """Print the number of tests, the median of errors over sigmas, and the shares of the verdicts."""
    if not tests:
        print(f"{name:35}{0:>7}")
        return
    times = np.sqrt(np.median([each.ratio for each in tests]))
    verdicts = [each.verdict for each in tests]
    shares = [verdicts.count(each) / len(tests) for each in ("consistent", "overconfident", "too cautious")]
    print(f"{name:35}{len(tests):>7}{times:>9.3g}{shares[0]:>12.1%}{shares[1]:>15.1%}{shares[2]:>14.1%}")


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
