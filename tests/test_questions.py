"""Filters beside `ekf` in the exercise's questions, with the public `assert_error_bounds`; `test_exercise` has the EKF.

Every run draws its start from the prior. Bounds on the error were chosen on other seeds than the ones below (from seed
1000 on): each is the 99.9 % quantile of the mean asserted here, so that an equally good filter exceeds it with
probability 0.1 %. The statistical levels are 99.9 %, two-sided.
"""

from __future__ import annotations

from functools import cache

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
MAPS = pytest.mark.parametrize("scenario", in_full(("q1-short-dense", "q1-long-dense", "q1-long-sparse")))


@cache
def scores(name: str, filter_name: str, runs: int, *overrides: str) -> list[Score]:
    """Return scores of `runs` runs (seeds 0, 1, ...) of a filter against the truth."""
    scenario = load_scenario(name, ["start=sampled", *overrides])
    estimator = load_estimators(
        [filter_name], association=scenario.association, initialisation=scenario.initialisation_settings
    )[filter_name]
    runs_of = (simulate(scenario, seed) for seed in range(runs))
    return [evaluate(truth, recording, estimator(recording)) for truth, recording in runs_of]


@pytest.mark.full  # statistics of many runs
@pytest.mark.parametrize(
    ("scenario", "runs", "overrides", "ate_m"),
    [
        ("q1-short-dense", 100, (), 0.20),
        ("q1-long-dense", 100, (), 0.27),
        ("q1-long-sparse", 100, (), 0.94),
        ("q2-short-dense", 24, (), 0.230),
        ("q2-long-dense", 24, (), 0.352),
        ("q2-long-sparse", 24, (), 1.623),
        ("q4-three-landmarks", 30, (DELAYED,), 0.751),
        ("q4-ring", 20, (DELAYED,), 0.849),
    ],
)
def test_error_of_the_right_invariant_filter(scenario: str, runs: int, overrides: tuple[str, ...], ate_m: float):
    assert_error_bounds(scores(scenario, "riekf", runs, *overrides), max_ate_m=ate_m)


@MAPS
def test_the_right_invariant_filter_is_consistent(scenario: str):
    assert_error_bounds(scores(scenario, "riekf", 100), nees_level=LEVEL, nis_level=LEVEL)


@MAPS
def test_dead_reckoning_is_consistent(scenario: str):
    assert_error_bounds(scores(scenario, "dead-reckoning", 100), nees_level=LEVEL)


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
@pytest.mark.parametrize("scenario", ["q2-short-dense", "q2-long-dense"])
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


@pytest.mark.full  # statistics of many runs
@pytest.mark.parametrize(("scenario", "runs"), [("q4-three-landmarks", 30), ("q4-ring", 20)])
def test_delayed_landmarks_keep_the_right_invariant_filter_consistent(scenario: str, runs: int):
    assert_error_bounds(scores(scenario, "riekf", runs, DELAYED), nees_level=LEVEL, nis_level=LEVEL)


@pytest.mark.parametrize("scenario", ["q4-three-landmarks", *in_full(["q4-ring"])])
def test_every_ray_becomes_a_point(scenario: str):
    for score in scores(scenario, "ekf", 10, "initialisation=fis"):
        assert score["rays"] is not None
        assert score["rays"].left == 0
        assert score["rays"].collapsed == score["landmarks_true"]
