"""`find_noise` on simulated logs with known noise and fixed seeds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import ndtri
from scipy.stats import kstest, norm

from slamgauge import Recording, UserError, find_noise, load_scenario, simulate
from slamgauge.compare.noise.diagnosis import autocorrelation, normal_quantiles, normal_scores, quantiles
from slamgauge.compare.noise.innovation_model import ErrorDistribution, NoiseModel
from slamgauge.compare.noise.likelihood import CRITICAL, Likelihood, intervals
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.noise.parameters import SYSTEMATIC
from slamgauge.compare.noise.report_text import noise_table
from slamgauge.se2 import wrap
from tests.marks import in_full

pytestmark = pytest.mark.slow

TRUE = {"forward": 0.03, "turn": math.radians(0.3), "range": 0.1, "bearing": math.radians(5.0)}
EXACT_RANGES = ("sensor.sigma_range=1e-6", "assumed.scale=1")


def recording_of(
    *overrides: str, scenario: str = "q1-short-dense", duration: float = 25.0, seed: int = 4, start: str = "sampled"
) -> Recording:
    settings = [f"trajectory.duration={duration}", f"start={start}", "assumed.scale=2", *overrides]
    return simulate(load_scenario(scenario, settings), seed)[1]


def with_range_errors(recording: Recording, errors: np.ndarray, scale: float = 1.0) -> Recording:
    observation = recording.observation.copy()
    observation[:, 0] = np.abs(observation[:, 0] + errors)
    cov = scale * np.diag([TRUE["range"] ** 2, TRUE["bearing"] ** 2])
    return replace(recording, observation=observation, observation_cov=np.broadcast_to(cov, (len(observation), 2, 2)))


def test_the_noise_of_a_simulated_log_is_found():
    """Twice the variance is assumed. An interval misses the truth in 1 of 20 logs; none of these four does."""
    found = find_noise(recording_of())
    for name, true in TRUE.items():
        sigma = found.parameters[name]
        assert sigma.low < true < sigma.high
        assert sigma.low < sigma.value < sigma.high
        assert found.assumed[name] == pytest.approx(math.sqrt(2.0) * true, rel=1e-9)
    assert found.parameters["lateral"].low == 0.0
    assert 0.0 < found.parameters["lateral"].high < 0.03
    assert found.parameters["range"].high < found.assumed["range"]
    assert found.outlier_rate == 0.0
    assert found.log_likelihood_gain > 100.0
    assert found.held_out is not None
    assert found.held_out.log_likelihood_gain > 50.0
    assert all(nis.low < nis.mean < nis.high for nis in found.after.nis.values())
    assert all(nis.mean < 0.8 for nis in found.before.nis.values())
    variances = [found.parameters[name].value ** 2 for name in ("range", "bearing")]
    np.testing.assert_allclose(found.tuned.observation_cov[0], np.diag(variances))
    assert find_noise(found.tuned).log_likelihood_gain == pytest.approx(0.0, abs=0.05)
    table = str(noise_table(found))
    assert all(text in table for text in ("lateral [m per step]", "any value below", "too large"))
    narrow = noise_table(found).text(80)
    assert "any value below" in narrow  # verdicts before assumed values
    assert "Hidden columns (show with --wide): assumed" in narrow
    assert noise_json(found)["parameters"]["range"]["unit"] == "m"


@pytest.mark.parametrize("share", [0.02, *in_full([0.1])])
def test_outliers_increase_a_rate_and_not_a_sigma(share: float):
    recording, rng = recording_of(), np.random.default_rng(0)
    wrong = rng.random(len(recording.observation)) < share
    observation = recording.observation.copy()
    observation[wrong, 0] = rng.uniform(0.0, 10.0, wrong.sum())
    found = find_noise(replace(recording, observation=observation))
    assert [*found.rates] == ["range"]
    assert found.outlier_rate == pytest.approx(wrong.mean(), rel=0.3)
    assert found.rates["range"].low < wrong.mean() < found.rates["range"].high
    for name in ("range", "bearing"):
        assert found.parameters[name].value == pytest.approx(TRUE[name], rel=0.05)
    assert found.before.nis["range"].mean > 2.0
    assert found.after.nis["range"].low < found.after.nis["range"].mean < found.after.nis["range"].high
    assert "outliers: " in str(noise_table(found))


@pytest.mark.full  # a long recording
def test_a_landmark_that_starts_with_an_outlier_starts_again():
    recording = recording_of()
    ids = np.asarray(recording.landmark)
    wrong = np.random.default_rng(1).random(len(ids)) < 0.03
    wrong[np.unique(ids, return_index=True)[1]] = False
    wrong[np.flatnonzero(ids == ids[0])[0]] = True
    found = find_noise(replace(recording, observation=recording.observation + np.outer(wrong, [4.0, 0.0])))
    assert found.first_sights_left_out == 1
    assert found.outlier_rate == pytest.approx(wrong.mean(), rel=0.3)
    assert len(found.tuned.observation) == len(ids)


@pytest.mark.full  # a long recording
def test_heavy_tails_without_a_gap_give_student_t():
    recording = recording_of(*EXACT_RANGES)
    errors = 0.1 * np.random.default_rng(2).standard_t(3.0, len(recording.observation))
    found = find_noise(with_range_errors(recording, errors))
    assert not found.rates
    assert 2.0 < found.values["range dof"] < 5.0
    assert found.parameters["range"].value == pytest.approx(0.1, rel=0.15)


def test_observations_with_correlated_errors_count_as_fewer():
    """Range errors of a landmark have a correlation of 0.9; in an average without end, 19 would count as one."""
    recording = recording_of(*EXACT_RANGES, duration=15.0)
    ids = np.asarray(recording.landmark).tolist()
    errors, last = np.random.default_rng(5).standard_normal(len(ids)), dict[int, float]()
    for place, each in enumerate(ids):
        if each in last:
            errors[place] = 0.9 * last[each] + math.sqrt(0.19) * errors[place]
        last[each] = float(errors[place])
    found = find_noise(with_range_errors(recording, 0.1 * errors, 4.0))
    assert 2.0 < found.sights_counted_as_one < 10.0
    for place, name in enumerate(("range", "bearing")):
        variance = found.sights_counted_as_one * found.parameters[name].value ** 2
        np.testing.assert_allclose(found.tuned.observation_cov[:, place, place], variance)
    assert "observations of a landmark count as one" in str(noise_table(found))
    assert noise_json(found)["sights_counted_as_one"] == found.sights_counted_as_one


def test_noise_that_is_less_likely_on_the_held_out_half_is_not_written():
    recording = recording_of("assumed.scale=1", duration=8.0, seed=3)
    found = find_noise(recording)
    assert found.held_out is not None
    assert found.held_out.log_likelihood_gain < 0.0
    small = str(noise_table(replace(found, held_out=found.held_out._replace(log_likelihood_gain=-0.01))))
    assert "gains +0.0 nats" in small
    assert "(+0.000 each)" in small
    assert found.tuned == recording
    assert "the assumed noise is kept" in str(noise_table(found))


def test_systematic_errors_are_found():
    recording = recording_of("assumed.scale=1", "motion.sigma_speed=0.02", "motion.sigma_yaw_rate_deg=0.5")
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.15, 0.04])
    odometry[:, :2] *= 1.05
    odometry[:, 2] += 0.01 * odometry[:, 0]
    observation[:, 1] = wrap(observation[:, 1])
    found = find_noise(replace(recording, odometry=odometry, observation=observation), systematic=True)
    for name, error in zip(SYSTEMATIC, (0.05, 0.01, 0.15, 0.04), strict=True):
        assert 0.0 < found.systematic[name].low < error < found.systematic[name].high
    np.testing.assert_allclose(found.tuned.odometry[:, 0].mean(), recording.odometry[:, 0].mean(), rtol=0.01)
    np.testing.assert_array_equal(found.tuned.observation[:, 1], observation[:, 1])
    table = str(noise_table(found))
    assert "the forward directions of sensor and odometry differ by +0.04" in table
    assert "here it is the sensor's, and odometry is rotated (--heading odometry chooses the odometry's)" in table


def test_landmarks_without_ids_are_associated():
    recording = recording_of(scenario="q2-short-dense", duration=12.0)
    assert recording.landmark is None
    found = find_noise(recording)
    assert found.tuned.landmark is None
    assert found.left_without_id < 0.02 * len(recording.observation)
    for name in ("range", "bearing"):
        assert found.parameters[name].value == pytest.approx(TRUE[name], rel=0.05)


def test_positions_have_one_sigma():
    recording = recording_of(scenario="ukfm-slam2d", duration=300, seed=0, start="mean")
    found = find_noise(recording)
    assert [*found.parameters] == ["forward", "lateral", "turn", "position"]
    assert found.parameters["position"].low < 0.1 < found.parameters["position"].high


@pytest.mark.parametrize(
    ("scenario", "keep", "message"),
    [
        ("q4-ring", 1000, "sensor: a bearing-only observation"),
        ("q1-short-dense", 1, "no landmark is observed twice"),
        ("q1-short-dense", 0, "no steps or no observations.*give a longer one"),
    ],
)
def test_a_log_that_does_not_determine_the_noise_is_refused(scenario: str, keep: int, message: str):
    recording = recording_of(scenario=scenario, duration=2.0)
    with pytest.raises(UserError, match=message):
        find_noise(recording.only(np.arange(len(recording.observation)) < keep))


def test_the_profile_likelihood_at_the_ends_of_an_interval_is_critical():
    """Another optimiser, without gradients, computes the profile."""
    model = NoiseModel(recording_of(duration=10.0))
    likelihood = Likelihood(model)
    best = likelihood.maximum(np.zeros(5))
    place = model.names.index("turn")
    others = np.delete(np.arange(len(best)), place)
    for end in intervals(likelihood, best, ["turn"])["turn"][1:]:

        def cost(point: np.ndarray, end: float = end) -> float:
            whole = best.copy()
            whole[place], whole[others] = math.log(end / model.parameters.begin["turn"]), point
            return -likelihood.value(whole)

        there = minimize(cost, best[others], method="Nelder-Mead", options={"maxiter": 400, "fatol": 1e-3})
        assert 2.0 * (likelihood.value(best) + there.fun) == pytest.approx(CRITICAL, abs=0.15)


def test_the_gradient_agrees_with_differences_and_the_maximum_is_the_highest_point():
    likelihood = Likelihood(NoiseModel(recording_of(duration=10.0)))
    point = np.array([0.1, -0.4, 0.2, -0.1, 0.05])
    gradient = likelihood.local(point).gradient
    for place, step in enumerate(1e-3 * np.eye(5)):
        central = (likelihood.value(point + step) - likelihood.value(point - step)) / 2e-3
        assert gradient[place] == pytest.approx(central, rel=5e-3, abs=0.1)
    best = likelihood.maximum(np.zeros(5))
    rng = np.random.default_rng(0)
    assert all(likelihood.value(best + 0.1 * rng.standard_normal(5)) < likelihood.value(best) + 0.01 for _ in range(20))


@pytest.mark.parametrize("kind", ["mixture", "student-t"])
def test_scores_under_the_right_distribution_are_normal(kind: str):
    """A Kolmogorov-Smirnov test at a level of 1 in 1000, with a fixed seed."""
    rng = np.random.default_rng(7)
    variances = rng.uniform(0.5, 2.0, 4000)
    if kind == "mixture":
        wide = np.where(rng.random(4000) < 0.1, 25.0, 0.0)
        errors, values = np.sqrt(variances + wide) * rng.standard_normal(4000), {"range rate": 0.1, "range spread": 5.0}
        scores = normal_scores(errors, variances, ErrorDistribution("range", "mixture"), values)
    else:
        errors = np.sqrt(variances) * rng.standard_t(4.0, 4000)
        scores = normal_scores(errors, variances, ErrorDistribution("range", "student-t"), {"range dof": 4.0})
    assert kstest(scores, norm.cdf).pvalue > 1e-3
    assert kstest(errors / np.sqrt(variances), norm.cdf).pvalue < 1e-3


def test_correlation_is_computed_within_each_landmark():
    rng = np.random.default_rng(1)
    scores = np.zeros((2, 5000))
    for place in range(1, 5000):
        scores[:, place] = 0.6 * scores[:, place - 1] + 0.8 * rng.standard_normal(2)
    found, pairs = autocorrelation(scores.T.reshape(-1, 1), np.tile([3, 8], 5000))
    assert pairs == 9998
    np.testing.assert_allclose(found[:3], [0.6, 0.36, 0.216], atol=0.05)


@pytest.mark.parametrize("count", [1, 2, 7, 5000])
def test_quantiles_reach_from_the_smallest_to_the_largest_score_and_have_their_scale(count: int):
    expected = normal_quantiles(count)
    scores = 3.0 * ndtri((np.arange(count) + 0.5) / count)
    found = quantiles(scores[np.random.default_rng(0).permutation(count)], expected)
    assert found[[0, -1]] == pytest.approx(scores[[0, -1]], abs=1e-9)
    assert np.diff(found).min() >= 0.0
    if count == 5000:
        dense = np.abs(expected) < 2.5  # beyond, few scores remain and interpolation is coarse
        np.testing.assert_allclose(found[dense], 3.0 * expected[dense], atol=0.01)
