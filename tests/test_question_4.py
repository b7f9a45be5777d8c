"""Question 4: bearing-only SLAM with two initialisations, compared with the causal optimum.

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

pytestmark = pytest.mark.full  # the exercise's figures, statistics of many runs

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
    ("q4-three-landmarks", "ekf", "delayed"): Bounds(0.774, 1.318),  # 0.593, 1.084
    ("q4-three-landmarks", "riekf", "delayed"): Bounds(0.751, 1.293),  # 0.584, 1.071
    ("q4-ring", "ekf", "fis"): Bounds(1.079, 2.122),  # 0.791, 1.353
    ("q4-ring", "riekf", "fis"): Bounds(0.822, 1.496),  # 0.637, 1.074
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
def test_the_innovations_of_points_are_as_large_as_expected(scenario: str):
    assert_error_bounds(of(scenario, "delayed", "riekf"), nis_level=LEVEL)


@SCENARIOS
def test_delayed_landmarks_keep_the_right_invariant_filter_consistent(scenario: str):
    assert_error_bounds(of(scenario, "delayed", "riekf"), nees_level=LEVEL)


def test_the_best_initialisation_is_within_the_bars():
    """Time-mean NEES/3; on the other seeds 0.98; resampled, none of the means exceeds the bar."""
    found = [score["nees_pose"] for score in of("q4-ring", "delayed", "riekf")]
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
