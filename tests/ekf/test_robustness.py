"""Robust updates: comparison with the textbook, and their accuracy and consistency with outliers.

Statistics have fixed seeds. The NEES of a consistent filter is in the two-sided chi-square band with three degrees of
freedom per run, which a right filter leaves once in a thousand tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.consistency import pose_errors, squared_mahalanobis
from slamgauge.ekf import (
    AssociatingFilter,
    Association,
    FilterSettings,
    Robustness,
    SlamFilter,
    ekf_slam,
    riekf,
)
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.truth import Truth
from tests.marks import in_full
from tests.reference.given import given
from tests.reference.random_recordings import random_recording
from tests.reference.textbook import PAIRS, fill_map

pytestmark = pytest.mark.slow

STUDENT = Robustness("student-t", degrees_of_freedom=2.5)


def with_outliers(recording: Recording) -> Recording:
    """Return the recording with an error of 6 standard deviations in every seventh observation."""
    wrong = recording.observation.copy()
    wrong[::7] += 6.0 * np.sqrt(np.diagonal(recording.observation_cov[::7], axis1=1, axis2=2))
    return replace(recording, observation=wrong)


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("seed", [0, *in_full([1, 2])])
@pytest.mark.parametrize(("ours", "textbook"), PAIRS.values(), ids=PAIRS)
def test_student_weights_equal_the_textbook(
    ours: Callable[..., Estimate], textbook: Callable[..., Estimate], seed: int, sensor: str
) -> None:
    _, recording = random_recording(seed, sensor=sensor, steps=60)
    recording = with_outliers(recording)
    actual, expected = ours(recording, FilterSettings(robust=STUDENT)), textbook(recording, 2.5)
    for name in ("poses", "pose_covs", "landmarks", "landmark_covs", "nis"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=1e-8, atol=1e-9, err_msg=name)
    assert np.abs(actual.poses - ours(recording).poses).max() > 1e-3


def test_the_weight_of_a_bearing_follows_from_its_distance() -> None:
    """A bearing has one row. Weights are at most 1."""
    cov, ids, noise = np.diag([0.04, 0.09, 0.01, 0.05, 0.02]), np.array([5]), np.array([[[0.02]]])
    for shift in (0.0, 0.4, 3.0):
        maps = [LandmarkMap("bearing", np.zeros(3), cov[:3, :3], "standard", 4, tails) for tails in (math.inf, 2.0)]
        for each in maps:
            fill_map(each, ids, np.array([[2.9, 0.8]]), cov)
        value = np.array([[0.2 + shift]])
        v, S = maps[0].innovations(ids, value, noise)
        weight = min(1.0, 3.0 / (2.0 + float(v[0, 0] ** 2 / S[0, 0, 0])))
        assert (weight < 1.0) == (shift > 0.0)
        maps[0].update(ids, value, noise / weight)
        maps[1].update(ids, value, noise)
        np.testing.assert_allclose(maps[1].pose, maps[0].pose, atol=1e-12)
        np.testing.assert_allclose(maps[1].cov, maps[0].cov, atol=1e-12)


@pytest.mark.parametrize("correction", ["standard", "iterated", "right-invariant"])
@pytest.mark.parametrize("method", ["nearest-neighbour", "jcbb"])
def test_weights_without_ids_equal_those_with_ids(
    method: Literal["nearest-neighbour", "jcbb"], correction: Literal["standard", "iterated", "right-invariant"]
) -> None:
    """One observation at a time, with correct associations."""
    start = (np.zeros(3), np.diag([0.01, 0.01, 1e-4]))
    known = SlamFilter("range-bearing", *start, correction, robust=STUDENT)
    unknown = AssociatingFilter("range-bearing", *start, correction, Association(method, 50.0), STUDENT)
    plain = SlamFilter("range-bearing", *start, correction)
    generator, R = np.random.default_rng(3), np.diag([0.01, 0.0025])[None]
    for _ in range(30):
        z = np.array([[4.0, 0.5]]) + generator.standard_t(2, 2) * [0.1, 0.05]
        for slam in (known, unknown, plain):
            slam.predict([0.0, 0.0, 0.0], np.diag([0.01, 0.01, 0.001]) ** 2)
            slam.update(Observations(np.array([0]), z, R))
    np.testing.assert_allclose(unknown.pose, known.pose, atol=1e-10)
    np.testing.assert_allclose(unknown.pose_cov, known.pose_cov, atol=1e-12)
    assert len(unknown.landmark_ids) == 1
    assert np.abs(plain.pose - known.pose).max() > 1e-4


def test_the_gate_of_the_settings_equals_the_gate_of_update() -> None:
    _, recording = random_recording(2, steps=30)
    recording = with_outliers(recording)
    chosen = ekf_slam(recording, FilterSettings(robust=Robustness("gate", gate=6.0)))
    slam = SlamFilter("range-bearing", recording.prior_mean, recording.prior_cov)
    for step, scan in enumerate(recording.scans()):
        if step:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        slam.update(scan, gate=6.0)
    np.testing.assert_array_equal(chosen.poses[-1], slam.pose)
    assert (given(chosen.association) == -1).sum() > 5


# --- accuracy and consistency --------------------------------------------------------------------

RUNS = 20


@cache
def recorded(rate: float) -> list[tuple[Truth, Recording]]:
    scenario = load_scenario("q1-short-dense", ["start=sampled", f"sensor.outlier_rate={rate}"])
    return [simulate(scenario, seed) for seed in range(RUNS)]


def judged(rate: float, robust: Robustness) -> tuple[float, float]:
    """Return mean NEES/3 from the 11th step on, and mean ATE [m], of the right-invariant filter."""
    nees, ates = np.empty(RUNS), np.empty(RUNS)
    for run, (truth, recording) in enumerate(recorded(rate)):
        estimate = riekf(recording, FilterSettings(robust=robust))
        errors: Float = pose_errors(given(truth.poses), estimate.poses)
        nees[run] = squared_mahalanobis(errors, given(estimate.pose_covs))[10:].mean() / 3
        ates[run] = np.sqrt((errors[:, :2] ** 2).sum(axis=1).mean())
    return float(nees.mean()), float(ates.mean())


BAND = chi2.ppf([0.0005, 0.9995], 3 * RUNS) / (3 * RUNS)


@pytest.mark.full  # a statistic of many runs
@pytest.mark.parametrize("rate", [0.0, 0.02, 0.1])
def test_with_a_gate_the_filter_is_consistent_and_as_accurate_as_without_outliers(rate: float) -> None:
    nees, ate = judged(rate, Robustness("gate"))
    assert BAND[0] < nees < BAND[1]
    assert 0.95 < ate / judged(0.0, Robustness())[1] < 1.05


@pytest.mark.parametrize(("rate", "least", "worst"), [(0.0, 0.95, 1.05), (0.02, 1.05, 1.25), (0.1, 1.2, 1.5)])
def test_student_weights_keep_most_of_the_accuracy(rate: float, least: float, worst: float) -> None:
    """Each outlier still has a small effect."""
    nees, ate = judged(rate, Robustness("student-t"))
    assert least < ate / judged(0.0, Robustness())[1] < worst
    assert BAND[0] < nees < (BAND[1] if rate < 0.1 else 2.0)


def test_outliers_ruin_an_unguarded_filter() -> None:
    nees, ate = judged(0.02, Robustness())
    assert nees > 20
    assert ate / judged(0.0, Robustness())[1] > 3
