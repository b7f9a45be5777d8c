"""Question 1: errors and consistency of each filter on three maps, with the public `assert_error_bounds`.

Every run draws its start from the prior. The bounds were chosen on other seeds than the ones below: the
errors on seeds 1000 to 1399, the ratios to the optimum on seeds 1000 to 1039. Each is that sample's mean
plus 3.3 standard errors of the mean asserted here, rounded up. An equally good filter exceeds a bound with
probability 0.1 % (the ratios, resampled: at most 0.15 %). The statistical levels are 99.9 %, two-sided: a
consistent filter fails one of them with probability 0.1 %.
"""

from __future__ import annotations

from typing import NamedTuple

import pytest

from slamgauge import assert_error_bounds
from tests.reference.question_scores import graded_scores, scores

pytestmark = pytest.mark.full  # the exercise's figures, statistics of many runs

FILTERS = ("dead-reckoning", "ekf", "riekf")
MAPS = ("q1-short-dense", "q1-long-dense", "q1-long-sparse")
LEVEL = 0.999
RUNS = 100  # without the optimum; seeds 0 ..
GRADED_RUNS = 10  # next to the optimum, which takes seconds; the first of them


class Bounds(NamedTuple):
    ate_m: float
    ratio_to_optimum: float


# on the other seeds: mean ATE and its standard deviation over runs [m]; mean ratio and its
BOUNDS = {
    ("q1-short-dense", "dead-reckoning"): Bounds(0.92, 11.0),  # 0.824, 0.280; 6.88, 3.91
    ("q1-short-dense", "ekf"): Bounds(0.23, 1.85),  # 0.194, 0.087; 1.27, 0.51
    ("q1-short-dense", "riekf"): Bounds(0.20, 1.20),  # 0.172, 0.075; 1.03, 0.13
    ("q1-long-dense", "dead-reckoning"): Bounds(2.20, 19.0),  # 1.935, 0.685; 11.3, 6.9
    ("q1-long-dense", "ekf"): Bounds(0.36, 2.60),  # 0.302, 0.167; 1.53, 0.93
    ("q1-long-dense", "riekf"): Bounds(0.27, 1.20),  # 0.233, 0.111; 1.02, 0.15
    ("q1-long-sparse", "dead-reckoning"): Bounds(2.20, 3.30),  # 1.935, 0.685; 2.51, 0.70
    ("q1-long-sparse", "ekf"): Bounds(0.95, 1.10),  # 0.846, 0.289; 1.013, 0.070
    ("q1-long-sparse", "riekf"): Bounds(0.94, 1.05),  # 0.841, 0.285; 1.005, 0.032
}


@pytest.mark.parametrize(("scenario", "name"), BOUNDS)
def test_error_against_the_truth(scenario: str, name: str):
    assert_error_bounds(scores(scenario, FILTERS, RUNS)[name], max_ate_m=BOUNDS[scenario, name].ate_m)


@pytest.mark.parametrize(("scenario", "name"), BOUNDS)
def test_error_against_the_optimum(scenario: str, name: str):
    ratio = BOUNDS[scenario, name].ratio_to_optimum
    assert_error_bounds(graded_scores(scenario, FILTERS, GRADED_RUNS)[name], max_ratio_to_optimum=ratio)


@pytest.mark.parametrize("scenario", MAPS[:2])
def test_dead_reckoning_is_far_from_the_optimum_of_a_dense_map(scenario: str):
    """On the other seeds no mean of ten runs came below three, of 40 000 resampled."""
    with pytest.raises(AssertionError, match="ratio_to_optimum = "):
        assert_error_bounds(graded_scores(scenario, FILTERS, GRADED_RUNS)["dead-reckoning"], max_ratio_to_optimum=3.0)


@pytest.mark.parametrize("scenario", MAPS)
def test_the_right_invariant_filter_is_consistent(scenario: str):
    assert_error_bounds(scores(scenario, FILTERS, RUNS)["riekf"], nees_level=LEVEL, nis_level=LEVEL)


@pytest.mark.parametrize("scenario", MAPS)
def test_dead_reckoning_is_consistent(scenario: str):
    assert_error_bounds(scores(scenario, FILTERS, RUNS)["dead-reckoning"], nees_level=LEVEL)


@pytest.mark.parametrize("scenario", MAPS)
def test_the_innovations_of_the_textbook_filter_are_as_large_as_expected(scenario: str):
    assert_error_bounds(scores(scenario, FILTERS, RUNS)["ekf"], nis_level=LEVEL)


def test_the_textbook_filter_is_overconfident_on_the_long_dense_map():
    """Its mean NEES on the other seeds is 5.5; resampled, the mean of a hundred runs was never inside the band."""
    with pytest.raises(AssertionError, match=r"1 error bound.*\n.*pose NEES .* the estimator is too sure$"):
        assert_error_bounds(scores("q1-long-dense", FILTERS, RUNS)["ekf"], nees_level=LEVEL, nis_level=LEVEL)
