"""Simulated outliers, clutter, missed landmarks and errors of odometry; none of them changes other draws.

Statistical tests use fixed seeds and two-sided bounds that a right simulator exceeds once in 10 000.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, poisson

from slamgauge.compare.storage.files import load_truth, save
from slamgauge.truth import NOBODY, Truth
from tests.reference.given import given

from .conftest import FALSE_ALARM_RATE, run

OUTLIERS = ("sensor.outlier_rate=0.1",)
CLUTTER = ("sensor.clutter_rate=0.5",)


@pytest.mark.parametrize(
    "option", [*OUTLIERS, "sensor.outlier_rate=1", *CLUTTER, "sensor.detection_probability=0.5", "motion.slip_rate=0.2"]
)
def test_an_option_changes_no_other_draws(option: str) -> None:
    plain_truth, plain = run("start=sampled")
    truth, recording = run("start=sampled", option)
    np.testing.assert_array_equal(truth.poses, plain_truth.poses)
    sound = np.flatnonzero(~truth.misleading) if truth.misleading is not None else np.arange(0)
    rows = {
        key: row for row, key in enumerate(zip(plain.observation_step, given(plain_truth.association), strict=True))
    }
    same = [rows[recording.observation_step[i], given(truth.association)[i]] for i in sound]
    np.testing.assert_array_equal(recording.observation[sound], plain.observation[same])
    if not option.startswith("motion"):
        np.testing.assert_array_equal(recording.odometry, plain.odometry)
        assert recording != plain


def test_a_higher_rate_keeps_the_outliers_of_a_lower_rate() -> None:
    few, many = (given(run(f"sensor.outlier_rate={rate}")[0].outlier) for rate in (0.02, 0.1))
    assert many[few].all()
    assert 0 < few.sum() < many.sum()


def assert_count(count: int, trials: int, probability: float) -> None:
    low, high = binom.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], trials, probability)
    assert low <= count <= high


def test_outliers_have_the_stated_rate_and_are_uniform() -> None:
    truth, recording = run(*OUTLIERS, "sensor.field_of_view_deg=180", "sensor.min_range=1")
    outlier = given(truth.outlier)
    assert_count(int(outlier.sum()), len(outlier), 0.1)
    ranges, bearings = recording.observation[outlier].T
    assert 1.0 <= ranges.min() < 2.0 < 9.0 < ranges.max() <= 10.0
    assert_count(int((bearings > 0).sum()), len(bearings), 0.5)
    assert 1.4 < np.abs(bearings).max() <= np.pi / 2


def test_wide_outliers_have_ten_times_the_noise() -> None:
    truth, recording = run("sensor.outlier_rate=1", "sensor.outlier=wide", "sensor.min_range=5")
    offsets = given(truth.landmarks)[truth.association] - given(truth.poses)[recording.observation_step, :2]
    noise = (recording.observation[:, 0] - np.hypot(*offsets.T)) / 1.0
    assert abs(noise.std() - 1.0) < 3.9 / np.sqrt(2 * len(noise))


def test_clutter_is_of_no_landmark_and_has_new_ids() -> None:
    truth, recording = run(*CLUTTER, "sensor.first_step=10")
    association, ids = given(truth.association), given(recording.landmark)
    clutter = association == NOBODY
    mean = 0.5 * (recording.steps + 1 - 10)
    low, high = poisson.ppf([FALSE_ALARM_RATE / 2, 1 - FALSE_ALARM_RATE / 2], mean)
    assert low <= clutter.sum() <= high
    assert recording.observation_step.min() >= 10
    assert not np.isin(ids[clutter], given(truth.landmark_ids)).any()
    assert len(np.unique(ids[clutter])) == clutter.sum()
    np.testing.assert_array_equal(ids[~clutter], association[~clutter])
    assert recording.observation[clutter, 0].max() <= 10.0


def test_field_of_view_and_detection_probability() -> None:
    truth, recording = run("sensor.field_of_view_deg=120", "sensor.sigma_bearing_deg=0.01")
    assert 1.0 < np.abs(recording.observation[:, 1]).max() < np.deg2rad(60.1)
    some = len(run("sensor.detection_probability=0.3")[1].observation)
    assert_count(some, len(run()[1].observation), 0.3)
    assert truth.outlier is None


def test_odometry_has_the_stated_errors() -> None:
    plain = run()[1].odometry
    longer = run("motion.scale_error=0.02")[1].odometry
    np.testing.assert_allclose(longer - plain, np.tile([0.002, 0.0, 0.0], (len(plain), 1)), atol=1e-15)
    turned = run("motion.turn_bias_per_metre=-0.1")[1].odometry
    np.testing.assert_allclose(turned - plain, np.tile([0.0, 0.0, -0.01], (len(plain), 1)), atol=1e-15)
    slipped = run("motion.slip_rate=0.2")[1].odometry - plain
    slips = slipped[:, 0] > 1e-12
    assert_count(int(slips.sum()), len(slips), 0.2)
    assert slipped[:, 0].max() <= 0.1 + 1e-12
    np.testing.assert_array_equal(slipped[~slips][:, 0].round(12), 0.0)
    np.testing.assert_allclose(slipped[:, 1:], 0.0, atol=1e-15)


def test_outliers_of_a_truth_are_stored_if_it_has_them(tmp_path: Path) -> None:
    for overrides in (OUTLIERS, ()):
        truth, _ = run(*overrides)
        save(tmp_path / "truth.npz", truth)
        assert load_truth(tmp_path / "truth.npz") == truth
    with np.load(tmp_path / "truth.npz") as file:
        assert {*file.files} == {field.name for field in fields(Truth)} - {"outlier"}
