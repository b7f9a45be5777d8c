"""Errors that last: what `slamgauge noise` makes of them, and what the filter is worth with it.

    python benchmarks/noise_lasting.py [--recordings 8] [--seed 1]

Recordings of `q1-short-dense` whose range and bearing errors are, for each landmark, those of a first-order
autoregressive process from sight to sight. For three pairs of correlations: ATE and NEES (3 when consistent) of the
right-invariant filter with the noise that was simulated (its sigmas, taken for white), with the sigmas found, and with
the covariances of observations that `--write` makes of them; and how many sights count as one there.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slamgauge import Recording, Truth, evaluate, load_scenario, riekf, simulate
from slamgauge.arrays import Float, Int
from slamgauge.compare.noise.autocorrelation import larger, lasting, sights_counted_as_one
from slamgauge.compare.noise.diagnosis import diagnose
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.compare.noise.outliers import fit
from slamgauge.se2 import wrap

CORRELATIONS = ((0.9, 0.9), (0.8, 0.4), (0.0, 0.0))  # of range and bearing
SIGMAS = (0.1, math.radians(5.0))  # m, rad
EXACT = ("sensor.sigma_range=1e-9", "sensor.sigma_bearing_deg=1e-7")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    titles = ("simulated", "found", "written")
    print("correlations  count as one" + "".join(f"{f'{each}: ATE [m]':>20}{'NEES':>6}" for each in titles))
    for correlations in CORRELATIONS:
        seeds = [options.seed * 1000 + number for number in range(options.recordings)]
        counted, scores = zip(*(graded(*made(seed, correlations)) for seed in seeds), strict=True)
        cells = "".join(f"{ate:20.3f}{nees:6.2f}" for ate, nees in np.mean(scores, axis=0))
        print(f"{correlations[0]:5.1f}{correlations[1]:7.1f}{np.mean(counted):14.2f}{cells}", flush=True)


def made(seed: int, correlations: tuple[float, float]) -> tuple[Truth, Recording]:
    """A recording whose errors last, and its truth."""
    truth, exact = simulate(load_scenario("q1-short-dense", ["start=sampled", *EXACT]), seed)
    ids, rng = exact.landmark, np.random.default_rng([seed, 1])
    assert ids is not None
    errors = np.column_stack([s * process(ids, r, rng) for s, r in zip(SIGMAS, correlations, strict=True)])
    observation = exact.observation + errors
    observation[:, 0], observation[:, 1] = np.abs(observation[:, 0]), wrap(observation[:, 1])
    covs = np.broadcast_to(np.diag(np.square(SIGMAS)), (len(ids), 2, 2))
    return truth, replace(exact, observation=observation, observation_cov=covs)


def process(ids: Int, correlation: float, rng: np.random.Generator) -> Float:
    """Errors (M,) of variance 1 that correlate so from sight to sight of a landmark."""
    errors = rng.standard_normal(len(ids))
    last: dict[int, float] = {}
    for place, each in enumerate(ids.tolist()):
        if each in last:
            errors[place] = correlation * last[each] + math.sqrt(1.0 - correlation**2) * errors[place]
        last[each] = float(errors[place])
    return errors


def graded(truth: Truth, recording: Recording) -> tuple[float, list[tuple[float, float]]]:
    """How many sights count as one, and ATE and NEES of the filter under each noise."""
    found = fit(NoiseModel(recording))
    model, values = found.model, found.values
    correlation = lasting(diagnose(model, found.innovations, values))
    counted = sights_counted_as_one(model, values, correlation)
    noises = (model.told.assumed, values, larger(model, values, counted))
    return counted, list(grades(truth, [model.told.under(each) for each in noises]))


def grades(truth: Truth, recordings: list[Recording]) -> Iterator[tuple[float, float]]:
    for recording in recordings:
        score = evaluate(truth, recording, riekf(recording))
        yield score.ate_m or math.nan, score.nees_pose or math.nan


if __name__ == "__main__":
    main()
