"""The noise that is found in simulated logs, whose noise is known. Seeds are fixed; nothing here is left to chance."""

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
from slamgauge.compare.noise.innovation_model import Law, NoiseModel
from slamgauge.compare.noise.likelihood import Likelihood
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.noise.profile_likelihood import CRITICAL, ends
from slamgauge.compare.noise.report_text import noise_table

TRUE = {"forward": 0.03, "turn": math.radians(0.3), "range": 0.1, "bearing": math.radians(5.0)}


def recording_of(*overrides: str, scenario: str = "q1-short-dense", duration: float = 25.0, seed: int = 4) -> Recording:
    settings = [f"trajectory.duration={duration}", "start=sampled", "assumed.scale=2", *overrides]
    return simulate(load_scenario(scenario, settings), seed)[1]


def with_outliers(recording: Recording, share: float) -> tuple[Recording, float]:
    rng = np.random.default_rng(0)
    wrong = rng.random(len(recording.observation)) < share
    observation = recording.observation.copy()
    observation[wrong, 0] = rng.uniform(0.0, 10.0, wrong.sum())
    return replace(recording, observation=observation), float(wrong.mean())


def test_the_noise_of_a_simulated_log_is_found():
    """Twice the variance was assumed. An interval misses the truth in 1 of 20 logs; of these four none does."""
    recording = recording_of()
    found = find_noise(recording)
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
    for nis in found.after.nis.values():
        assert nis.low < nis.mean < nis.high
    for nis in found.before.nis.values():
        assert nis.mean < 0.8
    np.testing.assert_allclose(
        found.told.observation_cov[0],
        np.diag([found.parameters["range"].value ** 2, found.parameters["bearing"].value ** 2]),
    )
    assert find_noise(found.told).log_likelihood_gain == pytest.approx(0.0, abs=0.05)
    table = str(noise_table(found))
    assert "lateral [m per step]" in table
    assert "any value below" in table
    assert "too large" in table
    narrow = noise_table(found).text(80)
    assert "any value below" in narrow  # verdicts before what was assumed
    assert "Hidden columns (show with --wide): assumed" in narrow
    assert noise_json(found)["parameters"]["range"]["unit"] == "m"


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_outliers_come_out_as_a_rate_and_not_as_a_larger_sigma(share: float):
    recording, true_share = with_outliers(recording_of(), share)
    found = find_noise(recording)
    assert [*found.rates] == ["range"]
    assert found.outlier_rate == pytest.approx(true_share, rel=0.3)
    assert found.rates["range"].low < true_share < found.rates["range"].high
    assert found.parameters["range"].value == pytest.approx(TRUE["range"], rel=0.05)
    assert found.parameters["bearing"].value == pytest.approx(TRUE["bearing"], rel=0.05)
    assert found.before.nis["range"].mean > 2.0
    assert found.after.nis["range"].low < found.after.nis["range"].mean < found.after.nis["range"].high
    assert "outliers: " in str(noise_table(found))


def test_a_landmark_that_begins_with_an_outlier_begins_again():
    recording = recording_of()
    ids = recording.landmark
    assert ids is not None
    rng = np.random.default_rng(1)
    observation = recording.observation.copy()
    wrong = rng.random(len(ids)) < 0.03
    wrong[np.unique(ids, return_index=True)[1]] = False
    first = int(np.flatnonzero(ids == ids[0])[0])
    wrong[first] = True
    observation[wrong, 0] += 4.0
    found = find_noise(replace(recording, observation=observation))
    assert found.first_sights_left_out == 1
    assert found.outlier_rate == pytest.approx(wrong.mean(), rel=0.3)
    assert len(found.told.observation) == len(ids)


def test_heavy_tails_without_a_gap_are_students():
    recording = recording_of("sensor.sigma_range=1e-6", "assumed.scale=1")
    noise = 0.1 * np.random.default_rng(2).standard_t(3.0, len(recording.observation))
    observation = np.abs(recording.observation + np.column_stack([noise, np.zeros_like(noise)]))
    observation[:, 1] = recording.observation[:, 1]
    covs = np.broadcast_to(np.diag([0.01, TRUE["bearing"] ** 2]), (len(noise), 2, 2))
    found = find_noise(replace(recording, observation=observation, observation_cov=covs))
    assert not found.rates
    assert 2.0 < found.values["range dof"] < 5.0
    assert found.parameters["range"].value == pytest.approx(0.1, rel=0.15)


def test_sights_whose_errors_last_count_as_less():
    """Range errors of a landmark correlate by .9 from sight to sight: averaged for ever, 19 would count as one."""
    recording = recording_of("sensor.sigma_range=1e-6", "assumed.scale=1", duration=15.0)
    ids = recording.landmark
    assert ids is not None
    errors, last = np.random.default_rng(5).standard_normal(len(ids)), dict[int, float]()
    for place, each in enumerate(ids.tolist()):
        if each in last:
            errors[place] = 0.9 * last[each] + math.sqrt(0.19) * errors[place]
        last[each] = float(errors[place])
    observation = recording.observation.copy()
    observation[:, 0] = np.abs(observation[:, 0] + 0.1 * errors)
    covs = np.broadcast_to(np.diag([0.04, 4.0 * TRUE["bearing"] ** 2]), (len(ids), 2, 2))
    found = find_noise(replace(recording, observation=observation, observation_cov=covs))
    assert 2.0 < found.sights_counted_as_one < 10.0
    for place, name in enumerate(("range", "bearing")):
        told = found.sights_counted_as_one * found.parameters[name].value ** 2
        np.testing.assert_allclose(found.told.observation_cov[:, place, place], told)
    assert "sights of a landmark count as one" in str(noise_table(found))
    assert noise_json(found)["sights_counted_as_one"] == found.sights_counted_as_one


def test_noise_that_loses_on_what_was_held_out_is_not_written():
    recording = recording_of("assumed.scale=1", duration=8.0, seed=3)
    found = find_noise(recording)
    assert found.held_out is not None
    assert found.held_out.log_likelihood_gain < 0.0
    hardly = replace(found, held_out=found.held_out._replace(log_likelihood_gain=-0.01))
    assert "gains +0.0 nats" in str(noise_table(hardly))
    assert "(+0.000 each)" in str(noise_table(hardly))
    assert found.told == recording
    assert "the noise assumed is kept" in str(noise_table(found))


def test_systematic_errors_are_found():
    recording = recording_of("assumed.scale=1", "motion.sigma_speed=0.02", "motion.sigma_yaw_rate_deg=0.5")
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.15, 0.04])
    odometry[:, :2] *= 1.05
    odometry[:, 2] += 0.01 * odometry[:, 0]
    observation[:, 1] = np.arctan2(np.sin(observation[:, 1]), np.cos(observation[:, 1]))
    found = find_noise(replace(recording, odometry=odometry, observation=observation), systematic=True)
    true = {"odometry_scale": 0.05, "turn_per_metre": 0.01, "range_offset": 0.15, "bearing_offset": 0.04}
    for name, error in true.items():
        assert found.systematic[name].low < error < found.systematic[name].high
        assert found.systematic[name].low > 0.0
    np.testing.assert_allclose(found.told.odometry[:, 0].mean(), recording.odometry[:, 0].mean(), rtol=0.01)
    np.testing.assert_array_equal(found.told.observation[:, 1], observation[:, 1])
    said = str(noise_table(found))
    assert "sensor and odometry disagree by +0.04" in said
    assert "taken for the sensor's, odometry is turned (--heading odometry: the other)" in said


def test_without_ids_landmarks_are_associated_inside():
    recording = recording_of(scenario="q2-short-dense", duration=12.0)
    assert recording.landmark is None
    found = find_noise(recording)
    assert found.told.landmark is None
    assert found.left_without_id < 0.02 * len(recording.observation)
    for name in ("range", "bearing"):
        assert found.parameters[name].value == pytest.approx(TRUE[name], rel=0.05)


def test_positions_have_one_sigma():
    recording = simulate(load_scenario("ukfm-slam2d", ["trajectory.duration=300", "assumed.scale=2"]), 0)[1]
    found = find_noise(recording)
    assert [*found.parameters] == ["forward", "lateral", "turn", "position"]
    assert found.parameters["position"].low < 0.1 < found.parameters["position"].high


@pytest.mark.parametrize(
    ("scenario", "keep", "message"),
    [
        ("q4-ring", 1000, "sensor: bearings alone"),
        ("q1-short-dense", 1, "no landmark is seen twice"),
        ("q1-short-dense", 0, "without steps or without observations"),
    ],
)
def test_a_log_that_tells_nothing_is_refused(scenario: str, keep: int, message: str):
    recording = recording_of(scenario=scenario, duration=2.0)
    with pytest.raises(UserError, match=message):
        find_noise(recording.only(np.arange(len(recording.observation)) < keep))


def test_the_ends_of_an_interval_lie_where_the_profile_is_critical():
    """The profile by another optimiser, which knows no gradient."""
    model = NoiseModel(recording_of(duration=10.0))
    likelihood = Likelihood(model)
    best = likelihood.maximum(model.start())
    place = model.names.index("turn")
    for end in ends(likelihood, best, place):
        others = np.delete(np.arange(len(best)), place)

        def cost(point: np.ndarray, end: float = end, others: np.ndarray = others) -> float:
            whole = best.copy()
            whole[place], whole[others] = end, point
            return -likelihood.value(whole)

        there = minimize(cost, best[others], method="Nelder-Mead", options={"maxiter": 400, "fatol": 1e-3})
        assert 2.0 * (likelihood.value(best) + there.fun) == pytest.approx(CRITICAL, abs=0.15)


def test_the_gradient_is_that_of_the_likelihood_and_nothing_lies_higher():
    model = NoiseModel(recording_of(duration=10.0))
    likelihood = Likelihood(model)
    point = np.array([0.1, -0.4, 0.2, -0.1, 0.05])
    gradient = likelihood.local(point).gradient
    for place in range(len(point)):
        step = np.zeros(len(point))
        step[place] = 1e-3
        central = (likelihood.value(point + step) - likelihood.value(point - step)) / 2e-3
        assert gradient[place] == pytest.approx(central, rel=5e-3, abs=0.1)
    best = likelihood.maximum(model.start())
    rng = np.random.default_rng(0)
    assert all(likelihood.value(best + 0.1 * rng.standard_normal(5)) < likelihood.value(best) + 0.01 for _ in range(20))


@pytest.mark.parametrize("kind", ["mixture", "student-t"])
def test_scores_under_the_right_law_are_normal(kind: str):
    """A Kolmogorov-Smirnov test at a level of 1 in 1000, with a fixed seed."""
    rng = np.random.default_rng(7)
    variances = rng.uniform(0.5, 2.0, 4000)
    if kind == "mixture":
        wide = np.where(rng.random(4000) < 0.1, 25.0, 0.0)
        errors = np.sqrt(variances + wide) * rng.standard_normal(4000)
        scores = normal_scores(errors, variances, Law("range", "mixture"), {"range rate": 0.1, "range spread": 5.0})
    else:
        errors = np.sqrt(variances) * rng.standard_t(4.0, 4000)
        scores = normal_scores(errors, variances, Law("range", "student-t"), {"range dof": 4.0})
    assert kstest(scores, norm.cdf).pvalue > 1e-3
    assert kstest(errors / np.sqrt(variances), norm.cdf).pvalue < 1e-3


def test_correlation_is_that_of_each_landmark_alone():
    rng = np.random.default_rng(1)
    scores = np.zeros((2, 5000))
    for place in range(1, 5000):
        scores[:, place] = 0.6 * scores[:, place - 1] + 0.8 * rng.standard_normal(2)
    found, pairs = autocorrelation(scores.T.reshape(-1, 1), np.tile([3, 8], 5000))
    assert pairs == 9998
    np.testing.assert_allclose(found[:3], [0.6, 0.36, 0.216], atol=0.05)


@pytest.mark.parametrize("count", [1, 2, 7, 5000])
def test_quantiles_reach_from_the_least_score_to_the_largest_and_tell_their_scale(count: int):
    expected = normal_quantiles(count)
    scores = 3.0 * ndtri((np.arange(count) + 0.5) / count)
    found = quantiles(scores[np.random.default_rng(0).permutation(count)], expected)
    assert found[[0, -1]] == pytest.approx(scores[[0, -1]], abs=1e-9)
    assert np.diff(found).min() >= 0.0
    if count == 5000:
        dense = np.abs(expected) < 2.5  # farther out scores are so few that chords between them tell
        np.testing.assert_allclose(found[dense], 3.0 * expected[dense], atol=0.01)
