"""Estimates that are significantly better than the causal optimum are reported, others are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import compare_estimators, load_estimators, load_scenario, riekf, simulate
from slamgauge.compare.scoring.comparison import table
from slamgauge.compare.scoring.intervals import Interval, ratio_interval
from slamgauge.compare.scoring.optimum_notes import beats_the_optimum, is_too_near_the_truth
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


@pytest.mark.parametrize(
    ("ratio", "runs", "is_reported"),
    [
        (Interval(0.75, 0.72, 0.78), 20, True),
        (Interval(0.99, 0.965, 1.015), 100, False),
        (Interval(0.95, 0.92, 0.98), 20, False),  # 95 % below, 99.9 % not
        (Interval(0.5, None, None), 1, False),
        (None, 20, False),
    ],
)
def test_ratios_over_runs(ratio: Interval | None, runs: int, is_reported: bool):
    note = beats_the_optimum(ratio, runs)
    assert (note is not None) == is_reported
    if note:
        assert note.startswith("its error is 0.75 ± 0.056 times the causal optimum's (99.9% interval): no filter can")


def test_estimators_as_good_as_the_optimum_are_rarely_reported():
    """The false-alarm rate is 1 in 2000; 0 to 7 of 4000 have a probability of 0.9989 then."""
    rng = np.random.default_rng(0)
    draws = rng.normal(1.0, 0.1, (4000, 2, 20))
    reported = sum(beats_the_optimum(ratio_interval(ours, best), 20) is not None for ours, best in draws)
    assert reported <= 7


def chance(seed: int, scale: float, sampled: float = 1.0) -> tuple[Truth, Estimate, Estimate]:
    """Return truth, an estimate with errors `scale` times the optimum's sigmas, and the optimum."""
    rng = np.random.default_rng(seed)
    steps = 50
    errors = np.tile(
        sampled * rng.normal(0.0, [1.0, 1.0, 0.1]), (steps, 1)
    )  # equal errors at all steps: the largest variation
    covs = np.tile(np.diag([1.0, 1.0, 0.01]), (steps, 1, 1))
    truth = Truth(np.zeros((steps, 3)))
    other = scale * sampled * np.tile(rng.normal(0.0, [1.0, 1.0, 0.1]), (steps, 1))
    return truth, Estimate("filtered", other, covs), Estimate("filtered", errors, covs)


def test_a_run_of_a_right_filter_is_rarely_too_near_the_truth():
    """Probability 0.0005 each at most: more than 5 of 2000 have one of 6e-4."""
    assert sum(is_too_near_the_truth(*chance(seed, 1.0)) for seed in range(2000)) <= 5


def test_a_run_that_uses_the_truth_is_reported_unless_the_optimum_is_as_near_by_its_start():
    assert is_too_near_the_truth(*chance(0, 0.01))
    assert not is_too_near_the_truth(*chance(0, 1.0, sampled=0.01))
    truth, estimate, optimum = chance(0, 0.01)
    assert not is_too_near_the_truth(truth, replace(estimate, kind="smoothed"), optimum)
    assert not is_too_near_the_truth(Truth(), estimate, optimum)


def test_the_table_has_the_note():
    truth, recording = simulate(load_scenario("q1-short-dense", ["start=sampled", "trajectory.duration=8"]), 1)
    assert truth.poses is not None
    poses = truth.poses + 1e-5

    def cheats(given: Recording) -> Estimate:
        return replace(riekf(given), poses=poses)

    estimators = {"cheats": cheats, **load_estimators(["riekf", "causal"])}
    lines = str(table(compare_estimators(truth, recording, estimators))).splitlines()
    assert [line.partition(":")[0] for line in lines if "significantly nearer to the truth" in line] == ["cheats"]
