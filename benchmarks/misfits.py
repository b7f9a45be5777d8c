"""How much longer do the optima take on logs that contradict their stated model?

    python benchmarks/misfits.py

The table has chi-square over its degrees of freedom, and the processor time of `batch` and `causal` relative to that on
the same log without misread ids, outliers or wrong noise. A line follows for each ratio above its bar.
"""

from __future__ import annotations

from slamgauge.blas_threads import pin_blas_threads

pin_blas_threads()

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from time import process_time

import numpy as np
import tyro

from slamgauge import batch, causal, load_scenario, simulate
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

STEPS = 300
SWAPPED = (0.01, 0.05, 0.1)  # shares of ids swapped among landmarks
OUTLIERS = 0.05  # share of observations with uniform errors
OUTLIER_RANGE, OUTLIER_BEARING = 3.0, 0.5  # m, rad
WRONG = 3.0  # factor of wrong standard deviations
REPEATS = 3  # the least of these times of the clean log counts; the first compiles
BARS = {"batch": 10.0, "causal": 30.0}  # largest ratio of the times with and without the misfit
OPTIMA: dict[str, Callable[[Recording], Estimate]] = {"batch": batch, "causal": causal}


def clean_log() -> Recording:
    """Return the first steps of a run of `q1-short-dense` with the true ids."""
    truth, recording = simulate(load_scenario("q1-short-dense", ["start=mean"]), 3)
    assert truth.association is not None
    return recording.associated(truth.association).first(STEPS)


def misfits(log: Recording) -> Iterator[tuple[str, Recording]]:
    """Yield names and logs."""
    ids = log.landmark
    assert ids is not None
    names, rng = np.unique(ids), np.random.default_rng(0)
    for share in SWAPPED:
        other = names[(np.searchsorted(names, ids) + rng.integers(1, len(names), len(ids))) % len(names)]
        yield f"{share:.0%} ids swapped", replace(log, landmark=np.where(rng.random(len(ids)) < share, other, ids))
    error = rng.uniform(-1.0, 1.0, log.observation.shape) * [OUTLIER_RANGE, OUTLIER_BEARING]
    rows = rng.random(len(ids)) < OUTLIERS
    yield f"{OUTLIERS:.0%} outliers", replace(log, observation=np.abs(log.observation + rows[:, None] * error))
    for times, word in ((WRONG, "large"), (1.0 / WRONG, "small")):
        covs = {name: times**2 * getattr(log, name) for name in ("odometry_cov", "observation_cov")}
        yield f"noise {WRONG:g} times too {word}", replace(log, **covs)


def seconds_of(run: Callable[[Recording], Estimate], log: Recording) -> tuple[float, float]:
    """Return the processor time [s] of an optimum, and its chi-square over the degrees of freedom."""
    start = process_time()
    found = run(log)
    assert found.chi_square is not None and found.chi_square_dof
    return process_time() - start, found.chi_square / found.chi_square_dof


def main() -> int:
    log, late = clean_log(), list[str]()
    clean = {name: min(seconds_of(run, log)[0] for _ in range(REPEATS)) for name, run in OPTIMA.items()}
    print(f"{'log':<26}{'chi2/dof':>10}" + "".join(f"{name:>10}" for name in OPTIMA))
    for name, wrong in misfits(log):
        found = {optimum: seconds_of(run, wrong) for optimum, run in OPTIMA.items()}
        ratios = {optimum: seconds / clean[optimum] for optimum, (seconds, _) in found.items()}
        fit = found["causal"][1]
        print(f"{name:<26}{fit:10.2f}" + "".join(f"{ratio:9.1f}x" for ratio in ratios.values()), flush=True)
        late += [
            f"{optimum}: more than {BARS[optimum]:g} times the time of the clean log, {name}"
            for optimum, ratio in ratios.items()
            if ratio > BARS[optimum]
        ]
    print(*late, sep="\n", end="")
    return 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
