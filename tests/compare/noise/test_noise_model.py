"""Parameters of a recording: form of the odometry noise, systematic errors, and coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge import Recording, load_scenario, riekf, simulate
from slamgauge.compare.noise.likelihood import NoiseModel
from slamgauge.compare.noise.parameters import SYSTEMATIC, NoiseParameters, odometry_form
from slamgauge.se2 import rotation, wrap

pytestmark = pytest.mark.slow

BIASES = dict(zip(SYSTEMATIC, (0.03, 0.02, 0.1, 0.2), strict=True))


def recording_of(*overrides: str) -> Recording:
    return simulate(load_scenario("q1-short-dense", ["trajectory.duration=15", *overrides]), 3)[1]


@given(st.integers(0, 10_000), st.integers(1, 3))
def test_the_form_of_covariances_reproduces_them(seed: int, rank: int):
    roots = np.random.default_rng(seed).standard_normal((4, 3, rank)) * np.array([[1.0], [1e-3], [0.1]])
    covs = roots @ roots.swapaxes(1, 2)
    form = odometry_form(covs)
    scale = np.sqrt(np.einsum("ni,nj->nij", *[np.diagonal(covs, axis1=1, axis2=2)] * 2))
    np.testing.assert_allclose(form.covariances(form.assumed) / scale, covs / scale, atol=1e-7)


def test_lateral_noise_excludes_the_effect_of_the_turn():
    """A sensor d ahead of the robot's centre moves sideways by the robot's slip plus d times the turn."""
    ahead, slip, turn = 0.22, 0.002, 0.01
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, ahead], [0.0, 0.0, 1.0]])
    cov = jacobian @ np.diag([0.03**2, slip**2, turn**2]) @ jacobian.T
    form = odometry_form(np.stack([cov, 4.0 * cov]))
    np.testing.assert_allclose(form.assumed, np.sqrt(2.5) * np.array([0.03, slip, turn]), rtol=1e-9)
    np.testing.assert_allclose(form.profile[1] / form.profile[0], 2.0)


def test_noise_that_is_not_stated_varies_like_forward_noise():
    form = odometry_form(np.stack([np.diag([1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 0.0])]))
    np.testing.assert_allclose(form.profile[:, 1], form.profile[:, 0])
    np.testing.assert_allclose(form.profile[:, 2], form.profile[:, 0])
    assert (odometry_form(np.zeros((2, 3, 3))).profile == 1.0).all()


def test_coordinates_of_one_are_the_assumed_noise():
    model = NoiseModel(recording_of("assumed.scale=2"))
    values = model.values([1.0] * 5)
    assert values["range"] == pytest.approx(0.1 * np.sqrt(2.0))
    assert values["turn"] == pytest.approx(np.deg2rad(0.3) * np.sqrt(2.0))
    own = model.parameters.recording_with(values | {"lateral": 0.0})
    np.testing.assert_allclose(own.odometry_cov, model.recording.odometry_cov, atol=1e-18)
    np.testing.assert_allclose(own.observation_cov, model.recording.observation_cov, rtol=1e-12)


def test_systematic_errors_are_removed_from_the_measurements():
    """For a log of even motion this is exact up to rounding, also for bearings across pi."""
    recording = recording_of("motion.sigma_speed=0", "motion.sigma_yaw_rate_deg=0")
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.1, 0.2])
    odometry[:, :2] *= 1.03
    odometry[:, 2] += 0.02 * np.hypot(recording.odometry[:, 0], recording.odometry[:, 1])
    observation[:, 1] = wrap(observation[:, 1])
    parameters = NoiseParameters(replace(recording, odometry=odometry, observation=observation))
    found = parameters.recording_with(dict.fromkeys(parameters.sigmas, 1.0) | BIASES)
    np.testing.assert_allclose(found.odometry, recording.odometry, atol=1e-12)
    np.testing.assert_allclose(found.observation, recording.observation, atol=1e-12)


def test_the_forward_direction_of_headings_only_rotates_the_map():
    """The map rotates about the start by the offset, because increments with their noise or bearings are rotated."""
    recording = recording_of()
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


def test_a_position_is_corrected_like_range_and_bearing():
    recording = recording_of()
    x = recording.observation[:, 0] * np.cos(recording.observation[:, 1])
    y = recording.observation[:, 0] * np.sin(recording.observation[:, 1])
    there = replace(recording, sensor="position", observation=np.column_stack([x, y]))
    values: dict[str, float] = dict.fromkeys(("forward", "lateral", "turn", "range", "bearing", "position"), 1.0)
    values |= dict(zip(SYSTEMATIC, (0.0, 0.0, 0.1, 0.2), strict=True))
    polar, cartesian = (NoiseParameters(each).recording_with(values).observation for each in (recording, there))
    np.testing.assert_allclose(np.hypot(*cartesian.T), polar[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.sin(np.arctan2(*cartesian.T[::-1]) - polar[:, 1]), 0.0, atol=1e-9)
