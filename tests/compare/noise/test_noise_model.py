"""What is told of a recording: the form of its odometry noise, its systematic errors, and the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge import Recording, UserError, load_scenario, riekf, simulate
from slamgauge.compare.noise.innovation_model import Law, NoiseModel
from slamgauge.compare.noise.odometry_form import odometry_form
from slamgauge.compare.noise.parameters import SYSTEMATIC, Told
from slamgauge.se2 import rotation, wrap


def recording_of(*overrides: str) -> Recording:
    return simulate(load_scenario("q1-short-dense", ["trajectory.duration=15", *overrides]), 3)[1]


@given(st.integers(0, 10_000), st.integers(1, 3))
def test_covariances_are_made_again_from_their_form(seed: int, rank: int):
    roots = np.random.default_rng(seed).standard_normal((4, 3, rank)) * np.array([[1.0], [1e-3], [0.1]])
    covs = roots @ roots.swapaxes(1, 2)
    form = odometry_form(covs)
    scale = np.sqrt(np.einsum("ni,nj->nij", *[np.diagonal(covs, axis1=1, axis2=2)] * 2))
    np.testing.assert_allclose(form.covariances(form.assumed) / scale, covs / scale, atol=1e-7)


def test_a_lever_is_taken_out_of_the_lateral_noise():
    """A sensor d ahead of the robot's centre: its sideways motion is the robot's slip and d times the turn."""
    ahead, slip, turn = 0.22, 0.002, 0.01
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, ahead], [0.0, 0.0, 1.0]])
    cov = jacobian @ np.diag([0.03**2, slip**2, turn**2]) @ jacobian.T
    form = odometry_form(np.stack([cov, 4.0 * cov]))
    np.testing.assert_allclose(form.assumed, np.sqrt(2.5) * np.array([0.03, slip, turn]), rtol=1e-9)
    np.testing.assert_allclose(form.profile[1] / form.profile[0], 2.0)


def test_noise_that_is_not_stated_varies_as_forward_does():
    form = odometry_form(np.stack([np.diag([1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 0.0])]))
    np.testing.assert_allclose(form.profile[:, 1], form.profile[:, 0])
    np.testing.assert_allclose(form.profile[:, 2], form.profile[:, 0])
    assert (odometry_form(np.zeros((2, 3, 3))).profile == 1.0).all()


@pytest.mark.parametrize("laws", [(), (Law("range", "mixture"), Law("bearing", "student-t"))])
def test_parameters_and_values_are_one(laws: tuple[Law, ...]):
    model = NoiseModel(recording_of(), systematic=True, laws=laws)
    point = np.linspace(-1.0, 1.0, len(model.names))
    np.testing.assert_allclose(model.parameters(model.values(point)), point, atol=1e-12)


def test_the_start_is_what_is_assumed():
    model = NoiseModel(recording_of("assumed.scale=2"))
    values = model.values(model.start())
    assert values["range"] == pytest.approx(0.1 * np.sqrt(2.0))
    assert values["turn"] == pytest.approx(np.deg2rad(0.3) * np.sqrt(2.0))
    own = model.told.under(values | {"lateral": 0.0})
    np.testing.assert_allclose(own.odometry_cov, model.recording.odometry_cov, atol=1e-18)
    np.testing.assert_allclose(own.observation_cov, model.recording.observation_cov, rtol=1e-12)


def test_systematic_errors_are_taken_out_of_the_measurements():
    """Those of a log of even motion, to rounding; bearings across the seam included."""
    recording = recording_of("motion.sigma_speed=0", "motion.sigma_yaw_rate_deg=0")
    errors = dict(zip(SYSTEMATIC, (0.03, 0.02, 0.1, 0.2), strict=True))
    odometry, observation = recording.odometry.copy(), recording.observation + np.array([0.1, 0.2])
    distance = np.hypot(odometry[:, 0], odometry[:, 1])
    odometry[:, :2] *= 1.03
    odometry[:, 2] += 0.02 * distance
    observation[:, 1] = np.arctan2(np.sin(observation[:, 1]), np.cos(observation[:, 1]))
    told = Told(replace(recording, odometry=odometry, observation=observation))
    found = told.under(dict.fromkeys(told.sigmas, 1.0) | errors)
    np.testing.assert_allclose(found.odometry, recording.odometry, atol=1e-12)
    np.testing.assert_allclose(found.observation, recording.observation, atol=1e-12)


def test_whose_straight_ahead_a_heading_is_turns_the_map_and_nothing_else():
    """About the start, by the offset: increments with their noise are turned, or bearings are."""
    recording = recording_of()
    told = Told(recording)
    values = told.begin | dict(zip(SYSTEMATIC, (0.03, 0.02, 0.1, 0.2), strict=True)) | {"lateral": 0.01}
    sensors, odometrys = told.under(values, "sensor"), told.under(values, "odometry")
    np.testing.assert_array_equal(sensors.observation[:, 1], recording.observation[:, 1])
    ours, theirs = riekf(sensors), riekf(odometrys)
    start = recording.prior_mean[:2]
    np.testing.assert_allclose(ours.poses[:, :2], start + (theirs.poses[:, :2] - start) @ rotation(0.2).T, atol=1e-9)
    np.testing.assert_allclose(wrap(ours.poses[:, 2] - theirs.poses[:, 2]), 0.0, atol=1e-9)
    assert ours.nis is not None
    assert theirs.nis is not None
    np.testing.assert_allclose(ours.nis, theirs.nis, rtol=1e-6)


def test_a_position_is_corrected_as_range_and_bearing_are():
    recording = recording_of()
    x = recording.observation[:, 0] * np.cos(recording.observation[:, 1])
    y = recording.observation[:, 0] * np.sin(recording.observation[:, 1])
    there = replace(recording, sensor="position", observation=np.column_stack([x, y]))
    values: dict[str, float] = dict.fromkeys(("forward", "lateral", "turn", "range", "bearing", "position"), 1.0)
    values |= dict(zip(SYSTEMATIC, (0.0, 0.0, 0.1, 0.2), strict=True))
    polar, cartesian = Told(recording).under(values).observation, Told(there).under(values).observation
    np.testing.assert_allclose(np.hypot(*cartesian.T), polar[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.sin(np.arctan2(*cartesian.T[::-1]) - polar[:, 1]), 0.0, atol=1e-9)


def test_a_recording_that_tells_no_noise_is_refused():
    recording = recording_of()
    with pytest.raises(UserError, match="without steps or without observations"):
        Told(recording.only(np.zeros(len(recording.observation), dtype=bool)))
    with pytest.raises(UserError, match="without steps or without observations"):
        Told(recording.first(0))
