"""`find_noise` on simulated logs with known noise, parameters of a recording, and the command `slamgauge noise`."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import binom

from slamgauge import Recording, UserError, find_noise, load_recording, load_scenario, riekf, save, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.noise.diagnosis import autocorrelation
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.likelihood import Fit, NoiseModel
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.noise.outliers import fit_without_outliers
from slamgauge.compare.noise.parameters import SYSTEMATIC, NoiseParameters, odometry_form
from slamgauge.compare.noise.tables import noise_page
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.se2 import rotation, wrap

pytestmark = pytest.mark.slow

TRUE = {"forward": 0.03, "turn": math.radians(0.3), "range": 0.1, "bearing": math.radians(5.0)}
CRITICAL = 3.841459  # 95 % quantile of chi-square with 1 degree of freedom


def recording_of(
    *overrides: str, scenario: str = "q1-short-dense", duration: float = 25.0, seed: int = 4, start: str = "sampled"
) -> Recording:
    settings = [f"trajectory.duration={duration}", f"start={start}", "assumed.scale=2", *overrides]
    return simulate(load_scenario(scenario, settings), seed)[1]


def ends(found: Interval) -> tuple[float, float]:
    """Return both ends of an interval that has them."""
    assert found.low is not None and found.high is not None
    return found.low, found.high


def has(found: Interval, true: float) -> bool:
    """Return whether an interval contains the true value."""
    return (found.low or 0.0) < true < (math.inf if found.high is None else found.high)


def text_of(found: Noise) -> str:
    return noise_page(noise_json(found)).text(80)


def test_the_noise_of_a_simulated_log_is_found():
    """Twice the variance is assumed. An interval misses the truth in 1 of 20 logs; none of these four does."""
    found = find_noise(recording_of(duration=15.0))
    for name, true in TRUE.items():
        sigma = found.parameters[name]
        assert has(sigma, true) and has(sigma, sigma.mean)
        assert found.assumed[name] == pytest.approx(math.sqrt(2.0) * true, rel=1e-9)
    lateral = found.parameters["lateral"]
    assert lateral.low == 0.0 and lateral.high is not None and 0.0 < lateral.high < 0.03
    assert ends(found.parameters["range"])[1] < found.assumed["range"]
    assert found.outliers == []
    assert found.log_likelihood_gain > 100.0
    assert found.held_out is not None and found.held_out.log_likelihood_gain > 50.0
    for channel, nis in found.after.nis.items():
        assert nis.mean is not None and nis.low is not None and nis.high is not None
        assert nis.low < nis.mean < nis.high
        assert (found.before.nis[channel].mean or 0.0) < 0.8
    variances = [found.parameters[name].mean ** 2 for name in ("range", "bearing")]
    np.testing.assert_allclose(found.tuned.observation_cov[0], np.diag(variances))
    assert find_noise(found.tuned).log_likelihood_gain == pytest.approx(0.0, abs=0.05)
    whole = str(noise_page(noise_json(found)))
    assert all(text in whole for text in ("lateral [m per step]", "any value below", "times too large"))
    assert "Hidden columns (show with --wide): assumed" in text_of(found)  # verdicts come before assumed values
    assert noise_json(found)["parameters"]["range"]["unit"] == "m"


LOGS = 24


@pytest.mark.full
def test_intervals_contain_the_truth_in_95_percent_of_logs():
    """The stated noise is wrong by 1.5 in either direction; bounds that right intervals fail in 1 of 1000 tests."""
    held = dict.fromkeys(TRUE, 0)
    for seed in range(LOGS):
        found = find_noise(recording_of(f"assumed.scale={2.25 if seed % 2 else 1 / 2.25}", duration=12.0, seed=seed))
        for name, true in TRUE.items():
            held[name] += has(found.parameters[name], true)
    least, most = binom.ppf([0.0005, 0.9995], len(TRUE) * LOGS, 0.95)
    assert least <= sum(held.values()) <= most
    assert min(held.values()) >= binom.ppf(0.0005 / len(TRUE), LOGS, 0.95)


@pytest.mark.full  # 12 s and more
@pytest.mark.parametrize("share", [0.02, 0.1])
def test_outliers_are_named_and_do_not_increase_a_sigma(share: float):
    recording, rng = recording_of(), np.random.default_rng(0)
    wrong = rng.random(len(recording.observation)) < share
    observation = recording.observation.copy()
    observation[wrong, 0] = rng.uniform(0.0, 10.0, wrong.sum())
    errors = np.abs(observation - recording.observation)[:, 0]
    found = find_noise(replace(recording, observation=observation))
    named = np.zeros(len(wrong), dtype=bool)
    named[[each.observation for each in found.outliers]] = True
    assert named[errors > 1.0].mean() > 0.95  # ten standard deviations
    assert not named[~wrong].sum() > 0.002 * len(wrong)
    for name in ("range", "bearing"):
        assert found.parameters[name].mean == pytest.approx(TRUE[name], rel=0.05)
    assert (found.after.nis["range"].mean or 0.0) == pytest.approx(1.0, abs=0.05)
    assert len(found.tuned.observation) == len(observation)
    first = found.outliers[0]
    assert first.step == recording.observation_step[first.observation]
    assert recording.landmark is not None and first.landmark == recording.landmark[first.observation]
    assert f"outliers: {named.sum()} of {len(wrong)} observations" in " ".join(text_of(found).split())


@pytest.mark.parametrize(("seed", "place", "error"), [(4, 0, 4.0), (1, 4, 1.5), (2, 0, 1.5), (2, 15, 1.5)])
def test_a_landmark_that_starts_with_an_outlier_starts_again(seed: int, place: int, error: float):
    """The wrong observation is named, not those after it, which disagree with it."""
    recording = recording_of("assumed.scale=1", duration=10.0, seed=seed)
    assert recording.landmark is not None
    wrong = int(np.flatnonzero(recording.landmark == place)[0])
    observation = recording.observation.copy()
    observation[wrong, 0] += error
    _, found = fit_without_outliers(NoiseModel(replace(recording, observation=observation)))
    assert [each.observation for each in found] == [wrong]


def test_noise_that_is_less_likely_on_the_held_out_half_is_not_written():
    recording = recording_of("assumed.scale=1", duration=8.0, seed=3)
    found = find_noise(recording)
    assert found.held_out is not None
    assert found.held_out.log_likelihood_gain < 0.0
    assert found.tuned == recording
    assert "the assumed noise is kept" in " ".join(text_of(found).split())


@pytest.mark.full  # 36 s
def test_systematic_errors_are_found():
    recording = recording_of("assumed.scale=1", "motion.sigma_speed=0.02", "motion.sigma_yaw_rate_deg=0.5")
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.15, 0.04])
    odometry[:, :2] *= 1.05
    odometry[:, 2] += 0.01 * odometry[:, 0]
    observation[:, 1] = wrap(observation[:, 1])
    found = find_noise(replace(recording, odometry=odometry, observation=observation), systematic=True)
    for name, error in zip(SYSTEMATIC, (0.05, 0.01, 0.15, 0.04), strict=True):
        low, high = ends(found.systematic[name])
        assert 0.0 < low < error < high
    np.testing.assert_allclose(found.tuned.odometry[:, 0].mean(), recording.odometry[:, 0].mean(), rtol=0.01)
    np.testing.assert_array_equal(found.tuned.observation[:, 1], observation[:, 1])
    table = " ".join(text_of(found).split())
    assert "the forward directions of sensor and odometry differ by +0.04" in table
    assert "here it is the sensor's, and odometry is rotated (--heading odometry chooses the odometry's)" in table


def test_landmarks_without_ids_are_associated():
    recording = recording_of(scenario="q2-short-dense", duration=12.0)
    assert recording.landmark is None
    found = find_noise(recording)
    assert found.tuned.landmark is None
    assert found.left_without_id < 0.02 * len(recording.observation)
    for name in ("range", "bearing"):
        assert found.parameters[name].mean == pytest.approx(TRUE[name], rel=0.05)


def test_positions_have_one_sigma():
    recording = recording_of(scenario="ukfm-slam2d", duration=300, seed=0, start="mean")
    found = find_noise(recording)
    assert [*found.parameters] == ["forward", "lateral", "turn", "position"]
    assert has(found.parameters["position"], 0.1)


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


def test_the_maximum_is_the_highest_point_and_the_profile_at_the_ends_of_an_interval_is_critical():
    """Another optimiser computes the profile."""
    model = NoiseModel(recording_of(duration=10.0))
    fit, rng = Fit(model), np.random.default_rng(0)

    def cost(point: np.ndarray) -> float:
        found = model.innovations(model.values(point))
        return math.inf if found is None else -float(found.log_likelihood.sum())

    best = np.array([fit.values[name] / model.parameters.begin[name] for name in model.names])
    assert all(cost(best + 0.1 * rng.standard_normal(5)) > cost(best) - 0.01 for _ in range(20))
    place = model.names.index("turn")
    for end in ends(fit.interval("turn")):

        def profile(point: np.ndarray, end: float = end) -> float:
            return cost(np.insert(point, place, end / model.parameters.begin["turn"]))

        start = np.delete(best, place)
        there = minimize(profile, start, method="Nelder-Mead", options={"maxiter": 400, "fatol": 1e-3})
        assert 2.0 * (there.fun - cost(best)) == pytest.approx(CRITICAL, abs=0.15)


def test_correlation_is_computed_within_each_landmark():
    rng = np.random.default_rng(1)
    scores = np.zeros((2, 5000))
    for place in range(1, 5000):
        scores[:, place] = 0.6 * scores[:, place - 1] + 0.8 * rng.standard_normal(2)
    found = autocorrelation(scores.T.reshape(-1, 1), np.tile([3, 8], 5000))
    assert found.band == pytest.approx(1.96 / 9998**0.5)
    assert found.value == pytest.approx(0.6, abs=0.05)


BIASES = dict(zip(SYSTEMATIC, (0.03, 0.02, 0.1, 0.2), strict=True))


def positions_of(recording: Recording) -> Recording:
    ranges, bearings = recording.observation.T
    positions = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    return replace(recording, sensor="position", observation=positions)


@given(st.integers(0, 10_000), st.integers(1, 3))
def test_the_form_of_covariances_reproduces_them(seed: int, rank: int):
    roots = np.random.default_rng(seed).standard_normal((4, 3, rank)) * np.array([[1.0], [1e-3], [0.1]])
    covs = roots @ roots.swapaxes(1, 2)
    form = odometry_form(covs)
    scale = np.sqrt(np.einsum("ni,nj->nij", *[np.diagonal(covs, axis1=1, axis2=2)] * 2))
    np.testing.assert_allclose(form.covariances(form.assumed) / scale, covs / scale, atol=1e-7)


def test_lateral_noise_excludes_the_effect_of_the_turn_and_unknown_noise_varies_like_forward_noise():
    """A sensor d ahead of the robot's centre moves sideways by the robot's slip plus d times the turn."""
    ahead, slip, turn = 0.22, 0.002, 0.01
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, ahead], [0.0, 0.0, 1.0]])
    cov = jacobian @ np.diag([0.03**2, slip**2, turn**2]) @ jacobian.T
    form = odometry_form(np.stack([cov, 4.0 * cov]))
    np.testing.assert_allclose(form.assumed, np.sqrt(2.5) * np.array([0.03, slip, turn]), rtol=1e-9)
    np.testing.assert_allclose(form.profile[1] / form.profile[0], 2.0)
    profile = odometry_form(np.stack([np.diag([1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 0.0])])).profile
    np.testing.assert_allclose(profile[:, 1:], profile[:, :1].repeat(2, axis=1))
    assert (odometry_form(np.zeros((2, 3, 3))).profile == 1.0).all()


@pytest.mark.parametrize("of", [lambda recording: recording, positions_of], ids=["range-bearing", "position"])
def test_systematic_errors_are_removed_from_the_measurements(of: Callable[[Recording], Recording]):
    """For a log of even motion this is exact up to rounding, also for bearings across pi."""
    recording = recording_of("motion.sigma_speed=0", "motion.sigma_yaw_rate_deg=0", duration=15.0)
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.1, 0.2])
    odometry[:, :2] *= 1.03
    odometry[:, 2] += 0.02 * np.hypot(recording.odometry[:, 0], recording.odometry[:, 1])
    observation[:, 1] = wrap(observation[:, 1])
    parameters = NoiseParameters(of(replace(recording, odometry=odometry, observation=observation)))
    found = parameters.recording_with(dict.fromkeys(parameters.sigmas, 1.0) | BIASES)
    np.testing.assert_allclose(found.odometry, recording.odometry, atol=1e-12)
    np.testing.assert_allclose(found.observation, of(recording).observation, atol=1e-12)


def test_the_forward_direction_of_headings_only_rotates_the_map():
    """The map rotates about the start by the offset, because increments with their noise or bearings are rotated."""
    recording = recording_of(duration=15.0)
    parameters = NoiseParameters(recording)
    values = parameters.begin | BIASES | {"lateral": 0.01}
    by_sensor, by_odometry = (parameters.recording_with(values, heading) for heading in ("sensor", "odometry"))
    np.testing.assert_array_equal(by_sensor.observation[:, 1], recording.observation[:, 1])
    one, other = riekf(by_sensor), riekf(by_odometry)
    start = recording.prior_mean[:2]
    np.testing.assert_allclose(one.poses[:, :2], start + (other.poses[:, :2] - start) @ rotation(0.2).T, atol=1e-9)
    np.testing.assert_allclose(wrap(one.poses[:, 2] - other.poses[:, 2]), 0.0, atol=1e-9)
    assert one.nis is not None and other.nis is not None
    np.testing.assert_allclose(one.nis, other.nis, rtol=1e-6)


def test_the_command_writes_its_findings_and_replaces_no_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    log, out, tuned = tmp_path / "log.npz", tmp_path / "out", tmp_path / "tuned" / "log.npz"
    save(log, recording_of("assumed.scale=4", duration=10.0, seed=2))
    assert main(["noise", str(log), "--out", str(out), "--write", str(tuned)]) == 0
    printed = capsys.readouterr()
    assert "times too large" in printed.out
    assert {*printed.err.splitlines()} == {f"written to {out}", f"written to {tuned}"}
    content = json.loads((out / "noise.json").read_text())
    assert {"parameters", "outlier_rate", "systematic", "nis_by_channel", "log_likelihood_gain"} < content.keys()
    sigma = content["parameters"]["range"]
    assert sigma["low"] < sigma["sigma"] < sigma["high"] < sigma["assumed"] == pytest.approx(0.2)
    np.testing.assert_allclose(load_recording(tuned).observation_cov[:, 0, 0], sigma["sigma"] ** 2)
    assert (out / "noise.svg").is_file()
    for write in (log, tuned):
        assert main(["noise", str(log), "--write", str(write)]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""  # before the estimation
        assert re.fullmatch(f"slamgauge: {write}: exists already; move it.*\n", printed.err)
