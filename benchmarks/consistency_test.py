"""Level and power of the consistency test without ground truth, on simulated recordings.

    python benchmarks/consistency_test.py [--scenario q1-short-dense] [--runs 100] [--twins 99] [--bugs 4]

The distribution of a consistent filter comes from `--twins` other seeds of the scenario, not from twins of each
recording, which would take 100 times as long. Rows are estimators: `causal` and `riekf` are consistent and show the
level, all others the power. `--bugs` recordings are given to each seeded bug.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

from references.seeded_bugs import SEEDED, seeded_ekf

from slamgauge import batch, causal, ekf_slam, riekf
from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.hausman import LEVEL, ConsistencyTest, consistency_test, step_statistics
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Filter = Callable[[Recording], Estimate]
SCALE = 1.5  # of the motion covariance: true over assumed


def main(scenario: str = "q1-short-dense", runs: int = 100, twins: int = 99, bugs: int = 4) -> int:
    loaded = load_scenario(scenario, ["start=sampled"])
    consistent = [simulate(loaded, 100_000 + seed)[1] for seed in range(twins)]
    null = np.array([step_statistics(riekf(each), batch(each)).ratio for each in consistent])
    print(f"{scenario}, {twins} twins: ratio {null.mean():.3f}, standard deviation {null.std():.3f}")
    print(f"{'estimator':42}{'runs':>5}{'ratio':>10}{'overconfident':>15}{'too cautious':>14}", flush=True)
    print_rows({"causal": causal, "riekf": riekf, "ekf": ekf_slam}, loaded, runs, null)
    for name, filter_ in {"riekf": riekf, "ekf": ekf_slam}.items():
        print_rows({f"{name}, Q {SCALE} times too small": filter_}, loaded, runs, null, 1.0 / SCALE)
        print_rows({f"{name}, Q {SCALE} times too large": filter_}, loaded, runs, null, SCALE)
    with np.errstate(all="ignore"):  # bugs may overflow
        for bug in SEEDED:
            print_rows({f"bug: {bug}": partial(seeded_ekf, bug=bug)}, loaded, bugs, null)
    return 0


def print_rows(filters: Mapping[str, Filter], scenario: Scenario, runs: int, null: Float, scale: float = 1.0) -> None:
    """Print a row for each filter; all assume the motion covariance times `scale`, and so does the optimum."""
    tests: dict[str, list[ConsistencyTest | None]] = {name: [] for name in filters}
    for seed in range(runs):
        drawn = simulate(scenario, seed)[1]
        recording = replace(drawn, odometry_cov=scale * drawn.odometry_cov)
        optimum = batch(recording)
        for name, filter_ in filters.items():
            try:
                statistics = step_statistics(filter_(recording), optimum)
                tests[name].append(consistency_test(statistics, null))
            except (UserError, np.linalg.LinAlgError, ValueError):  # bugs may raise errors
                tests[name].append(None)
    for name, found in tests.items():
        valid = [each for each in found if each is not None and np.isfinite(each.ratio)]
        if not valid:
            print(f"{name:42}{len(found):>5}  no valid estimate", flush=True)
            continue
        over = np.mean([each.p_value <= LEVEL for each in valid])
        under = np.mean([each.p_cautious <= LEVEL for each in valid])
        ratio = np.median([each.ratio for each in valid])
        print(f"{name:42}{len(valid):>5}{ratio:>10.3g}{over:>15.1%}{under:>14.1%}", flush=True)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
