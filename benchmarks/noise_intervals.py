"""Do the intervals of `slamgauge noise` hold the truth; a table of the sigmas, one of recordings with outliers.

    python benchmarks/noise_intervals.py [--recordings 200] [--outliers 40] [--duration SECONDS] [--seed 1] [--jobs 2]

Recordings of `q1-long-dense` and `q1-short-dense` in turn, simulated with .5, 1 or 2 times the practical's noise, of
motion and of the sensor each, in every third with 3 or 6 mm of lateral noise a step; what is assumed is off by up to a
factor of 1.65 for each sigma. Found over true: how many of the 95 % intervals hold 1, and the median. Then --outliers
recordings with 2 % and as many with 10 % of the ranges drawn evenly from 0 to 10 m. All last as long as their scenario
says, or --duration. Seconds are those of one core.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import math
from dataclasses import replace
from time import process_time
from typing import NamedTuple

import numpy as np

from slamgauge import Recording, find_noise, load_scenario, simulate
from slamgauge.compare.noise.estimation import Supported
from slamgauge.compare.studies.executors import local_processes

SCENARIOS = ("q1-long-dense", "q1-short-dense")
LEVELS = (0.5, 1.0, 2.0)
LATERAL = (0.003, 0.006)  # m per step
SIGMAS = ("forward", "turn", "range", "bearing")
OFF = 0.5  # largest logarithm of an assumed sigma over the true one
RATES = (0.02, 0.10)
FARTHEST = 10.0  # m
COLUMNS = {"sigma": 9, "number": 8, "held": 8, "too low": 9, "too high": 10, "median": 9, "interval": 11}


class Case(NamedTuple):
    """A recording to be made and fitted."""

    number: int
    seed: int
    outlier_rate: float
    duration: float | None  # s; None: the scenario's


class Result(NamedTuple):
    """What was found, over the truth."""

    case: Case
    sigmas: dict[str, Supported]  # lateral is missing where there is none
    outlier_rate: float  # found
    true_rate: float  # of this recording
    gain: float
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--outliers", type=int, default=40)
    parser.add_argument("--duration", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    seed, duration = options.seed, options.duration
    clean = [Case(number, seed, 0.0, duration) for number in range(options.recordings)]
    dirty = [Case(number, seed, rate, duration) for rate in RATES for number in range(options.outliers)]
    with local_processes(options.jobs) as executor:
        found = [*executor.map(find, [*clean, *dirty])]
    titles = "".join(f"{title:>{width}}" for title, width in COLUMNS.items())
    print(f"{'recordings':16}{titles}")
    for place, scenario in enumerate(SCENARIOS):
        print_sigmas(scenario, [each for each in found[: len(clean)] if each.case.number % 2 == place])
    print_sigmas("both", found[: len(clean)])
    print(f"\n{'outliers':10}" + "".join(f"{name:>9}" for name in SIGMAS) + f"{'rate/true':>11}{'worst rates':>16}")
    for rate in RATES:
        print_outliers(rate, [each for each in found[len(clean) :] if each.case.outlier_rate == rate])
    for name, some in (("without outliers", found[: len(clean)]), ("with outliers", found[len(clean) :])):
        seconds = [each.seconds for each in some] or [math.nan]
        print(f"seconds a recording, {name}: median {np.median(seconds):.1f}, longest {max(seconds):.1f}")


def find(case: Case) -> Result:
    recording, truth, true_rate = made(case)
    start = process_time()
    noise = find_noise(recording)
    seconds = process_time() - start
    sigmas = {name: over(noise.parameters[name], sigma) for name, sigma in truth.items() if sigma > 0.0}
    return Result(case, sigmas, noise.outlier_rate, true_rate, noise.log_likelihood_gain, seconds)


def made(case: Case) -> tuple[Recording, dict[str, float], float]:
    """The recording, its true sigmas, and the share of its ranges that are outliers."""
    rng = np.random.default_rng([case.seed, case.number, round(1000 * case.outlier_rate)])
    motion, sensor = rng.choice(LEVELS, 2)
    lateral = rng.choice(LATERAL) if case.number % 3 == 0 else 0.0
    scenario = load_scenario(
        SCENARIOS[case.number % 2],
        [
            *("start=sampled", f"motion.sigma_speed={0.3 * motion}", f"motion.sigma_yaw_rate_deg={3 * motion}"),
            *(f"sensor.sigma_range={0.1 * sensor}", f"sensor.sigma_bearing_deg={5 * sensor}"),
            *([] if case.duration is None else [f"trajectory.duration={case.duration}"]),
        ],
    )
    _, recording = simulate(scenario, int(rng.integers(2**31)))
    dt = scenario.trajectory.step
    truth = dict(zip(("forward", "turn"), dt * motion * np.array([0.3, math.radians(3.0)]), strict=True))
    truth |= {"lateral": lateral, "range": 0.1 * sensor, "bearing": math.radians(5.0) * sensor}
    odometry, observation = recording.odometry.copy(), recording.observation.copy()
    odometry[:, 1] += lateral * rng.standard_normal(recording.steps)
    wrong = rng.random(len(observation)) < case.outlier_rate
    observation[wrong, 0] = rng.uniform(0.0, FARTHEST, wrong.sum())
    off = np.exp(rng.uniform(-OFF, OFF, 5))
    motion_off, sensor_off = np.diag(off[:3]), np.diag(off[3:])
    assumed = recording.odometry_cov + np.diag([0.0, lateral**2, 0.0])
    told = replace(
        recording,
        odometry=odometry,
        observation=observation,
        odometry_cov=motion_off @ assumed @ motion_off,
        observation_cov=sensor_off @ recording.observation_cov @ sensor_off,
    )
    return told, truth, float(wrong.mean())


def over(found: Supported, truth: float) -> Supported:
    return Supported(*(each / truth for each in found))


def print_sigmas(name: str, results: list[Result]) -> None:
    for sigma in (*SIGMAS, "lateral"):
        found = [each.sigmas[sigma] for each in results if sigma in each.sigmas]
        if not found:
            continue
        values = np.array(found)
        low, high = values[:, 1] > 1.0, values[:, 2] < 1.0
        width = np.median(np.log(np.minimum(values[:, 2], 1e3) / np.maximum(values[:, 1], 1e-3))) / 2
        print(
            f"{name:16}{sigma:>9}{len(found):8}{np.mean(~(low | high)):8.1%}{high.mean():9.1%}{low.mean():10.1%}"
            f"{np.median(values[:, 0]):9.4f}{'± ' + format(width, '.1%'):>11}",
            flush=True,
        )


def print_outliers(rate: float, results: list[Result]) -> None:
    if not results:
        return
    medians = [np.median([each.sigmas[name].value for each in results]) for name in SIGMAS]
    rates = np.array([each.outlier_rate / each.true_rate for each in results])
    worst = f"{rates.min():.3f} to {rates.max():.3f}"
    print(f"{rate:<10.0%}" + "".join(f"{each:9.4f}" for each in medians) + f"{np.median(rates):11.4f}{worst:>16}")


if __name__ == "__main__":
    main()
