"""Filters beside `ekf` in the exercise's questions, with the public `assert_error_bounds`; `test_exercise` has the EKF.

Every run draws its start from the prior. Bounds on the error were chosen on other seeds than the ones below (from seed
1000 on): each is the 99.9 % quantile of the mean asserted here, so that an equally good filter exceeds it with
probability 0.1 %. The statistical levels are 99.9 %, two-sided.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from slamgauge import (
    Association,
    MapManagement,
    Score,
    assert_error_bounds,
    evaluate,
    load_estimators,
    load_scenario,
    riekf,
    simulate,
)
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.ekf import FilterSettings
from tests.marks import in_full

pytestmark = pytest.mark.slow

LEVEL = 0.999
JCBB, DELAYED = "association.method=jcbb", "initialisation=delayed"


@cache
def scores(name: str, filter_name: str, runs: int, *overrides: str) -> list[Score]:
    """Return scores of `runs` runs (seeds 0, 1, ...) of a filter against the truth."""
    scenario = load_scenario(name, ["start=sampled", *overrides])
    estimator = load_estimators(
        [filter_name], association=scenario.association, initialisation=scenario.initialisation_settings
    )[filter_name]
    runs_of = (simulate(scenario, seed) for seed in range(runs))
    return [evaluate(truth, recording, estimator(recording)) for truth, recording in runs_of]


CONSISTENT = {"nees_level": LEVEL, "nis_level": LEVEL}


@pytest.mark.full  # statistics of many runs
@pytest.mark.parametrize(
    ("filter_name", "scenario", "runs", "overrides", "bounds"),
    [
        ("riekf", "q1-short-dense", 100, (), CONSISTENT | {"max_ate_m": 0.20}),
        ("riekf", "q1-long-dense", 100, (), CONSISTENT | {"max_ate_m": 0.27}),
        ("riekf", "q1-long-sparse", 100, (), CONSISTENT | {"max_ate_m": 0.94}),
        ("riekf", "q2-short-dense", 24, (), {"max_ate_m": 0.230}),
        ("riekf", "q2-long-dense", 24, (), {"max_ate_m": 0.352}),
        ("riekf", "q2-long-sparse", 24, (), {"max_ate_m": 1.623}),
        ("riekf", "q4-three-landmarks", 30, (DELAYED,), CONSISTENT | {"max_ate_m": 0.751}),
        ("riekf", "q4-ring", 20, (DELAYED,), CONSISTENT | {"max_ate_m": 0.849}),
        ("dead-reckoning", "q1-short-dense", 100, (), {"nees_level": LEVEL}),
        ("dead-reckoning", "q1-long-dense", 100, (), {"nees_level": LEVEL}),
        ("dead-reckoning", "q1-long-sparse", 100, (), {"nees_level": LEVEL}),
    ],
)
def test_error_and_consistency_are_within_bounds(
    filter_name: str, scenario: str, runs: int, overrides: tuple[str, ...], bounds: dict[str, Any]
):
    assert_error_bounds(scores(scenario, filter_name, runs, *overrides), **bounds)


@pytest.mark.full  # a statistic of many runs
def test_the_textbook_filter_is_overconfident_on_the_long_dense_map():
    """Its mean NEES on the other seeds is 5.5; resampled, the mean of a hundred runs was never inside the band."""
    with pytest.raises(AssertionError, match=r"1 error bound.*\n.*pose NEES .* the estimator is too sure$"):
        assert_error_bounds(scores("q1-long-dense", "ekf", 100), nees_level=LEVEL, nis_level=LEVEL)


@pytest.mark.full  # gate 1 takes seconds
def test_gate_1_maps_many_duplicates():
    """On the other seeds every run of gate 1 mapped more than thirty times the 37 true landmarks."""
    for score in scores("q2-gate-1", "ekf", 2):
        assert score["landmarks_true"] == 37
        assert score["landmarks_mapped"] > 20 * 37
        assert score["landmarks_missed"] == 0


@pytest.mark.full  # statistics of many runs
@pytest.mark.parametrize(
    "scenario",
    [
        "q2-short-dense",
        pytest.param(
            "q2-long-dense",
            marks=pytest.mark.xfail(
                strict=True,
                raises=AssertionError,
                reason="merging in pairs leaves duplicates in a quarter of the maps; 0.5 compared all jointly",
            ),
        ),
    ],
)
def test_with_joint_compatibility_the_map_is_complete_and_the_right_invariant_filter_consistent(scenario: str):
    """On the other seeds 99 maps in 100 were complete and none larger; its NEES was 2.99 and 3.07."""
    runs = 24
    found = scores(scenario, "riekf", runs, JCBB)
    assert sum(score["landmarks_mapped"] == score["landmarks_true"] for score in found) >= 0.95 * runs
    wrong = sum(score["wrong_associations"] or 0 for score in found)
    assert wrong < 0.001 * runs * (6800 if scenario == "q2-short-dense" else 14600)  # observations of a run
    assert_error_bounds(found, nees_level=LEVEL)


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="after 40 s without landmarks a single observation fits a wrong landmark; 0.5 weighed several scans jointly",
)
@pytest.mark.parametrize(("root", "run"), [(0, 7), pytest.param(100, 17, marks=pytest.mark.full)])
def test_a_loop_closes_with_the_right_landmarks_though_the_position_is_uncertain(root: int, run: int):
    """Earlier versions merged landmarks with neighbours, or measured their age in scans instead of in time."""
    truth, recording = simulate(load_scenario("q2-long-sparse", ["start=sampled"]), run_seed(root, run))
    estimate = riekf(recording, FilterSettings(Association("jcbb", map_management=MapManagement())))
    assert truth.landmarks is not None
    assert len(estimate.landmark_ids) == len(truth.landmarks)


def test_all_scales_have_the_same_measurements_and_the_optimum_has_the_true_noise():
    told = simulate(load_scenario("q1-long-sparse"), 3)[1]
    for scale in (0.1, 1, 2, 10):
        scenario = load_scenario(f"q3-scale-{scale:g}")
        recording = simulate(scenario, 3)[1]
        np.testing.assert_array_equal(recording.observation, told.observation)
        np.testing.assert_array_equal(recording.odometry, told.odometry)
        np.testing.assert_allclose(recording.odometry_cov, scale * told.odometry_cov, rtol=1e-15)
        np.testing.assert_allclose(recording.observation_cov, scale * told.observation_cov, rtol=1e-15)
        assert recording.landmark is None
        known = simulate(informed(scenario), 3)[1]
        np.testing.assert_array_equal(known.observation_cov, told.observation_cov)
        np.testing.assert_array_equal(known.landmark, told.landmark)


@pytest.mark.parametrize("scenario", ["q4-three-landmarks", *in_full(["q4-ring"])])
def test_every_ray_becomes_a_point(scenario: str):
    for score in scores(scenario, "ekf", 10, "initialisation=fis"):
        assert score["rays"] is not None
        assert score["rays"]["left"] == 0
        assert score["rays"]["collapsed"] == score["landmarks_true"]


def test_the_constants_of_the_ukfm_benchmark_are_the_published_ones():
    """`benchmarks/published_ukfm.py` compares the figures of its filters."""
    truth, recording = simulate("ukfm-slam2d", 0)
    assert truth.landmarks is not None
    assert (recording.steps, len(truth.landmarks)) == (2500, 20)
    radius = 0.25 / np.deg2rad(1.5)
    np.testing.assert_allclose(np.hypot(*(truth.landmarks - [0.0, radius]).T), radius + 3.0, atol=1e-5)
    sigma_speed, sigma_yaw_rate = 0.05 * 0.25 / np.sqrt(2), 0.05 * 0.25 * 2 * np.sqrt(2)
    np.testing.assert_allclose(np.diag(recording.odometry_cov[0]), [sigma_speed**2, 0.0, sigma_yaw_rate**2], rtol=1e-12)
    assert not recording.prior_cov.any()
    distance = np.hypot(*recording.observation.T)
    assert 0.5 < distance.min() < distance.max() < 5.5  # visible from 1 to 5 m, with noise of 0.1 m
