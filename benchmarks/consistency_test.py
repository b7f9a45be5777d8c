"""How often does the consistency test without ground truth reject right filters (level), and wrong ones (power)?

    python benchmarks/consistency_test.py [--scenario q1-short-dense] [--set KEY=VALUE] [--estimators causal,riekf,ekf]
        [--runs 200] [--twins 199] [--q 1,1.5]

The start and the noise of every recording are random. The distribution of a consistent filter comes from `--twins`
other seeds of the scenario, shared by all recordings. `--q` has values of the true covariance of the odometry divided
by the one that filters and optimum assume. The estimator `bugs` means all bugs of `tests/reference/seeded_bugs.py` and
the same EKF without a bug.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the references

from slamgauge import batch, causal, ekf_slam, riekf
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.without_truth import (
    ConsistencyTest,
    Figures,
    consistent_filter,
    expected_nees,
    figures,
    figures_of,
)
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator
from slamgauge.recording import Recording
from tests.reference.seeded_bugs import SEEDED, seeded_ekf

FILTERS: dict[str, Estimator] = {"causal": causal, "riekf": riekf, "ekf": ekf_slam}
BUGS: dict[str, Estimator] = {bug or "no bug": partial(seeded_ekf, bug=bug) for bug in ("", *SEEDED)}
FIRST_TWIN = 100_000  # seed


def main(
    scenario: str = "q1-short-dense",
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = (),
    estimators: str = "causal,riekf,ekf",
    runs: int = 200,
    twins: int = 199,
    q: str = "1",
) -> int:
    filters = BUGS if estimators == "bugs" else {name: FILTERS[name] for name in estimators.split(",")}
    assumed = load_scenario(scenario, set)
    log = recording_of(assumed, 1.0, 0)
    consistent = {name: (consistent_filter(name, log), None) for name in filters}
    found = figures_of(consistent, (simulate(assumed, FIRST_TWIN + seed)[1] for seed in range(twins)))
    print(f"{'estimator':42}{'tested':>7}{'sigmas':>9}{'consistent':>12}{'overconfident':>15}{'too cautious':>14}")
    for ratio in map(float, q.split(",")):
        recordings = (recording_of(assumed, ratio, seed) for seed in range(runs))
        for name, tested in tests_of(filters, recordings, found).items():
            print_row(name if ratio == 1.0 else f"{name}, true Q {ratio:g} times as large", tested)
    return 0


def recording_of(scenario: Scenario, ratio: float, seed: int) -> Recording:
    """Simulate a recording whose odometry noise has `ratio` times the stated covariance, the scenario's."""
    motion = scenario.motion
    assert motion.sigma_speed is not None
    assert motion.sigma_yaw_rate_deg is not None
    larger = {
        "sigma_speed": np.sqrt(ratio) * motion.sigma_speed,
        "sigma_yaw_rate_deg": np.sqrt(ratio) * motion.sigma_yaw_rate_deg,
    }
    recording = simulate(scenario.model_copy(update={"motion": motion.model_copy(update=larger)}), seed)[1]
    return replace(recording, odometry_cov=recording.odometry_cov / ratio)


def tests_of(
    filters: Mapping[str, Estimator], recordings: Iterable[Recording], found: Mapping[str, Figures]
) -> dict[str, list[ConsistencyTest]]:
    """Test filters on recordings with the figures of twins."""
    tests: dict[str, list[ConsistencyTest]] = {name: [] for name in filters}
    for recording in recordings:
        optimum = batch(recording)
        for name, filter_ in filters.items():
            with suppress(UserError, np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):  # bugs
                expected = expected_nees(filter_(recording), optimum)
                tests[name].append(ConsistencyTest(figures(recording, optimum, expected), found[name]))
    return tests


def print_row(name: str, tests: list[ConsistencyTest]) -> None:
    """Print the number of tests, the median of errors over sigmas, and the shares of the verdicts."""
    tests = [each for each in tests if np.isfinite(each.log.means[0])]
    if not tests:
        print(f"{name:42}{0:>7}", flush=True)
        return
    times = np.sqrt(np.median([each.log.means[0] for each in tests]))
    verdicts = [each.verdict for each in tests]
    shares = [verdicts.count(each) / len(tests) for each in ("consistent", "overconfident", "too cautious")]
    print(f"{name:42}{len(tests):>7}{times:>9.3g}{shares[0]:>12.1%}{shares[1]:>15.1%}{shares[2]:>14.1%}", flush=True)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
