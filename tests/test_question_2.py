"""Question 2: filters without landmark ids, with the public `assert_error_bounds`.

Every run draws its start from the prior. Bounds were chosen on other seeds than the ones below (1000 to 1199, on the
sparse map 1000 to 1399; ratios on the dense maps 1000 to 1099): each is the 99.9 % quantile of the mean asserted here,
resampled from that sample, because single runs have very large errors. An equally good filter exceeds a bound with
probability 0.1 %, and the bounds of the mean map size on either side too. The statistical levels are 99.9 %, two-sided.
"""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge import Association, MapManagement, Score, assert_error_bounds, load_scenario, riekf, simulate
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.ekf import FilterSettings
from tests.reference.question_scores import Expected, graded_scores, scores

pytestmark = pytest.mark.full  # the exercise's figures, statistics of many runs

FILTERS = ("ekf", "riekf")
RUNS = 24  # without the optimum; seeds 0 ..
GRADED_RUNS = 5  # next to the optimum; the first of them
LEVEL = 0.999
JCBB = ("association.method=jcbb",)


NEAREST_NEIGHBOUR = {
    ("q2-short-dense", "ekf"): Expected(0.276, 2.41, (58.1, 4.5)),  # means 0.208, 1.32
    ("q2-short-dense", "riekf"): Expected(0.230, 1.39, (58.4, 4.5)),  # 0.180, 1.07
    ("q2-long-dense", "ekf"): Expected(0.525, 5.13, (121.2, 6.2)),  # 0.380, 2.05
    ("q2-long-dense", "riekf"): Expected(0.352, 2.44, (121.0, 6.3)),  # 0.271, 1.33
    ("q2-long-sparse", "ekf"): Expected(1.665, 2.87, (16.8, 3.2)),  # 1.12, 1.34
    ("q2-long-sparse", "riekf"): Expected(1.623, 2.84, (16.8, 3.2)),  # 1.10, 1.31
    ("q2-gate-100", "ekf"): Expected(4.602, 46.95, (48.1, 10.5)),  # 3.26, 19.0
    ("q2-gate-100", "riekf"): Expected(3.945, 51.25, (48.5, 10.8)),  # 2.66, 16.1
}
CASES = pytest.mark.parametrize(("scenario", "name"), NEAREST_NEIGHBOUR)


def mean_ate(found: list[Score]) -> float:
    return float(np.mean([score["ate_m"] for score in found if score["ate_m"] is not None]))


@CASES
def test_error_against_the_truth(scenario: str, name: str):
    bound = NEAREST_NEIGHBOUR[scenario, name].ate_m
    assert_error_bounds(scores(scenario, FILTERS, RUNS)[name], max_ate_m=bound)


@CASES
def test_error_against_the_optimum(scenario: str, name: str):
    bound = NEAREST_NEIGHBOUR[scenario, name].ratio
    assert_error_bounds(graded_scores(scenario, FILTERS, GRADED_RUNS)[name], max_ratio_to_optimum=bound)


@CASES
def test_map_size(scenario: str, name: str):
    mean, deviation = NEAREST_NEIGHBOUR[scenario, name].mapped
    mapped = [score["landmarks_mapped"] for score in scores(scenario, FILTERS, RUNS)[name]]
    assert abs(np.mean(mapped) - mean) <= 3.3 * deviation * np.sqrt(1 / RUNS + 1 / 200)  # both are samples


@pytest.mark.parametrize("name", FILTERS)
def test_gate_1_maps_many_duplicates_and_costs_several_times_the_error_of_the_optimum(name: str):
    """On the other seeds every run of gate 1 mapped more than thirty times the 37 true landmarks."""
    found = graded_scores("q2-gate-1", FILTERS, 2)[name]
    for score in found:
        assert score["landmarks_true"] == 37
        assert score["landmarks_mapped"] > 20 * 37
        assert score["landmarks_missed"] == 0
    assert_error_bounds(found, max_ate_m=3.6)  # twenty other runs: 1.64 and 1.44, deviation 0.83 and 0.82
    with pytest.raises(AssertionError, match="ratio_to_optimum = "):
        assert_error_bounds(found, max_ratio_to_optimum=2.0)
    with pytest.raises(AssertionError, match="too sure"):
        assert_error_bounds(found, nees_level=LEVEL)


OVERCONFIDENT = [case for case in NEAREST_NEIGHBOUR if case[1] == "ekf" or case[0] in ("q2-long-sparse", "q2-gate-100")]


@pytest.mark.parametrize(("scenario", "name"), OVERCONFIDENT)
def test_wrong_associations_make_filters_overconfident(scenario: str, name: str):
    """NEES at the end on the other seeds: 6.8 and 9.1 (ekf, dense), more than 100 (sparse), thousands (gate 100)."""
    with pytest.raises(AssertionError, match=r"pose NEES .* too sure"):
        assert_error_bounds(scores(scenario, FILTERS, RUNS)[name], nees_level=LEVEL)


@pytest.mark.parametrize("scenario", ["q2-short-dense", "q2-long-dense"])
def test_on_dense_maps_the_right_invariant_filter_is_closer_to_consistency(scenario: str):
    """NEES at the end on the other seeds: 3.5 and 3.9, where 3 is consistent; for ekf 6.8 and 9.1."""
    found = scores(scenario, FILTERS, RUNS)
    invariant, textbook = (np.mean([score.nees[-1] for score in found[name]]) for name in ("riekf", "ekf"))
    assert abs(invariant - 3.0) < 0.5 * abs(textbook - 3.0)


def test_gate_100_costs_several_times_the_error_of_gate_9():
    large, right = (mean_ate(scores(name, FILTERS, RUNS)["ekf"]) for name in ("q2-gate-100", "q2-long-dense"))
    assert large > 3 * right  # 8.6 times on the other seeds


@pytest.mark.parametrize("name", FILTERS)
def test_duplicate_landmarks_make_the_innovations_too_small(name: str):
    """Observations outside the gate begin a new landmark; the others have three quarters of the expected NIS."""
    with pytest.raises(AssertionError, match=r"NIS .* too cautious"):
        assert_error_bounds(scores("q2-long-dense", FILTERS, RUNS)[name], nis_level=LEVEL)


@pytest.mark.parametrize("scenario", ["q2-short-dense", "q2-long-dense"])
def test_with_joint_compatibility_the_map_is_complete_and_the_right_invariant_filter_consistent(scenario: str):
    """On the other seeds 99 maps in 100 were complete and none larger; its NEES was 2.99 and 3.07."""
    found = scores(scenario, FILTERS, RUNS, JCBB)["riekf"]
    assert sum(score["landmarks_mapped"] == score["landmarks_true"] for score in found) >= 0.95 * RUNS
    wrong = sum(score["wrong_associations"] or 0 for score in found)
    assert wrong < 0.001 * RUNS * (6800 if scenario == "q2-short-dense" else 14600)  # observations of a run
    assert_error_bounds(found, nees_level=LEVEL)


@pytest.mark.parametrize("scenario", ["q2-short-dense", "q2-long-dense"])
def test_joint_compatibility_costs_hardly_any_accuracy(scenario: str):
    """Mean ATE within 3 % of known association, on the same measurements."""
    blind = mean_ate(scores(scenario, FILTERS, RUNS, JCBB)["riekf"])
    known = mean_ate(scores(scenario.replace("q2", "q1"), FILTERS, RUNS)["riekf"])
    assert blind <= 1.03 * known


def test_with_joint_compatibility_the_textbook_filter_is_still_overconfident():
    with pytest.raises(AssertionError, match="too sure"):
        assert_error_bounds(scores("q2-long-dense", FILTERS, RUNS, JCBB)["ekf"], nees_level=LEVEL)


@pytest.mark.parametrize(("root", "run"), [(0, 7), (100, 17), (100, 22)])
def test_a_loop_closes_with_the_right_landmarks_though_the_position_is_uncertain(root: int, run: int) -> None:
    """Earlier versions merged landmarks with neighbours, or in (0, 7) measured their age in scans, not in time."""
    truth, recording = simulate(load_scenario("q2-long-sparse", ["start=sampled"]), run_seed(root, run))
    estimate = riekf(recording, FilterSettings(Association("jcbb", map_management=MapManagement())))
    assert truth.landmarks is not None
    assert len(estimate.landmark_ids) == len(truth.landmarks)
