"""Question 4: bearing-only SLAM with three initialisations, compared with the causal optimum.

Every run draws its start from the prior. Bounds were chosen on other seeds than the ones below (200 runs from seed
1000): each is the 99.9 % quantile of the mean asserted here, resampled from that sample; an equally good filter exceeds
a bound with probability 0.1 %. The statistical levels are 99.9 %, two-sided.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from slamgauge import Score, assert_error_bounds
from tests.reference.question_scores import graded_scores, scores

FILTERS = ("ekf", "riekf")
RUNS = {"q4-three-landmarks": 30, "q4-ring": 20}  # without the optimum; seeds 0 ..
GRADED_RUNS = {"q4-three-landmarks": 20, "q4-ring": 8}  # next to the optimum; the first of them
LEVEL = 0.999


class Bounds(NamedTuple):
    ate_m: float
    ratio_to_optimum: float


BOUNDS = {
    ("q4-three-landmarks", "ekf", "fis"): Bounds(0.858, 1.522),  # means 0.639, 1.169
    ("q4-three-landmarks", "riekf", "fis"): Bounds(0.767, 1.309),  # 0.596, 1.071
    ("q4-three-landmarks", "ekf", "inverse-depth"): Bounds(0.733, 1.111),  # 0.568, 1.014
    ("q4-three-landmarks", "riekf", "inverse-depth"): Bounds(0.731, 1.105),  # 0.564, 1.007
    ("q4-three-landmarks", "ekf", "delayed"): Bounds(0.774, 1.318),  # 0.593, 1.084
    ("q4-three-landmarks", "riekf", "delayed"): Bounds(0.751, 1.293),  # 0.584, 1.071
    ("q4-ring", "ekf", "fis"): Bounds(1.079, 2.122),  # 0.791, 1.353
    ("q4-ring", "riekf", "fis"): Bounds(0.822, 1.496),  # 0.637, 1.074
    ("q4-ring", "ekf", "inverse-depth"): Bounds(0.784, 1.361),  # 0.608, 1.079
    ("q4-ring", "riekf", "inverse-depth"): Bounds(0.772, 1.324),  # 0.605, 1.073
    ("q4-ring", "ekf", "delayed"): Bounds(0.892, 1.686),  # 0.675, 1.201
    ("q4-ring", "riekf", "delayed"): Bounds(0.849, 1.606),  # 0.661, 1.181
}
CASES = pytest.mark.parametrize(("scenario", "name", "initialisation"), BOUNDS)
SCENARIOS = pytest.mark.parametrize("scenario", RUNS)


def of(scenario: str, initialisation: str, name: str) -> list[Score]:
    return scores(scenario, FILTERS, RUNS[scenario], (f"initialisation={initialisation}",))[name]


@CASES
def test_error_against_the_truth(scenario: str, name: str, initialisation: str):
    bound = BOUNDS[scenario, name, initialisation].ate_m
    assert_error_bounds(of(scenario, initialisation, name), max_ate_m=bound)


@CASES
def test_error_against_the_optimum(scenario: str, name: str, initialisation: str):
    bound = BOUNDS[scenario, name, initialisation].ratio_to_optimum
    overrides = (f"initialisation={initialisation}",)
    found = graded_scores(scenario, FILTERS, GRADED_RUNS[scenario], overrides)[name]
    assert_error_bounds(found, max_ratio_to_optimum=bound)


@SCENARIOS
@pytest.mark.parametrize("initialisation", ["inverse-depth", "delayed"])
def test_the_innovations_of_points_are_as_large_as_expected(scenario: str, initialisation: str):
    assert_error_bounds(of(scenario, initialisation, "riekf"), nis_level=LEVEL)


@SCENARIOS
def test_delayed_landmarks_keep_the_right_invariant_filter_consistent(scenario: str):
    assert_error_bounds(of(scenario, "delayed", "riekf"), nees_level=LEVEL)


def test_the_best_initialisation_is_within_the_bars():
    """Time-mean NEES/3; on the other seeds 1.15 and 0.98; resampled, 0.8 % and none of the means exceed the bar."""
    for initialisation in ("inverse-depth", "delayed"):
        found = [score["nees_pose"] for score in of("q4-ring", initialisation, "riekf")]
        assert np.mean([nees for nees in found if nees is not None]) / 3 <= 1.5


def test_rays_make_the_textbook_filter_overconfident():
    """Its time-mean NEES/3 on the other seeds is 2.6; resampled, 0.4 % of the means of 20 runs come below 1.5."""
    found = [score["nees_pose"] for score in of("q4-ring", "fis", "ekf")]
    assert np.mean([nees for nees in found if nees is not None]) / 3 > 1.5


@SCENARIOS
@pytest.mark.parametrize("name", FILTERS)
def test_every_ray_becomes_a_point(scenario: str, name: str):
    for score in of(scenario, "fis", name):
        assert score["rays"] is not None
        assert score["rays"].left == 0
        assert score["rays"].collapsed == score["landmarks_true"]


def test_the_sliding_window_is_as_good_as_the_causal_optimum():
    """Over 100 runs of another root seed the mean ratio is 0.999, its deviation 0.015."""
    found = graded_scores("q4-ring", ("sliding-window",), 4)["sliding-window"]
    assert_error_bounds(found, max_ratio_to_optimum=1.05, nees_level=LEVEL)


def test_bearings_of_one_degree_without_ids_cost_hardly_any_accuracy():
    """Earlier versions closed loops with wrong landmarks in one run of six, with five to eight times the error."""
    sharp = "sensor.sigma_bearing_deg=1"
    methods = [(sharp, f"association.method={method}") for method in ("jcbb", "known")]
    blind, known = (scores("q4-ring", ("riekf",), 6, each)["riekf"] for each in methods)
    assert sum(each["ate_m"] or np.nan for each in blind) <= 1.1 * sum(each["ate_m"] or np.nan for each in known)
