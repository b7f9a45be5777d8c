"""The likelihood of a log, compared with the filter and with densities by scipy."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from scipy.stats import norm

from slamgauge import Recording, UserError, load_scenario, riekf, simulate
from slamgauge.ekf.innovations import Log, _run
from tests.reference.random_recordings import bearing_only


def recording_of(*overrides: str, seed: int = 3) -> Recording:
    return simulate(load_scenario("q1-short-dense", ["trajectory.duration=20", "start=sampled", *overrides]), seed)[1]


def innovations_of(recording: Recording):
    given = (recording.odometry, recording.odometry_cov, recording.observation, recording.observation_cov)
    found = Log(recording).innovations(*given)
    assert found is not None
    return found


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_it_equals_the_right_invariant_filter(sensor: str):
    recording = recording_of()
    if sensor == "position":
        distance, bearing = recording.observation.T
        values = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])
        covs = np.broadcast_to(np.diag([0.2, 0.3]), (len(values), 2, 2))
        recording = replace(recording, sensor="position", observation=values, observation_cov=covs)
    found = innovations_of(recording)
    nis = np.nansum(found.value**2 / found.variance, axis=1)
    per_step = np.bincount(recording.observation_step, weights=nis, minlength=recording.steps + 1)
    expected = riekf(recording).nis
    assert expected is not None
    np.testing.assert_allclose(per_step, expected, rtol=1e-9, atol=1e-9)
    density = norm.logpdf(found.value, scale=np.sqrt(found.variance))
    np.testing.assert_allclose(found.log_likelihood, np.nan_to_num(density), rtol=1e-12, atol=1e-12)


def test_all_observations_of_the_first_step_of_a_landmark_carry_no_likelihood():
    recording = recording_of()
    first = np.flatnonzero(recording.observation_step == recording.observation_step[0])
    ids = recording.landmark
    assert ids is not None
    twice = recording.only(np.sort(np.concatenate([np.arange(len(ids)), first[:1]])))
    found = innovations_of(twice)
    assert np.isnan(found.value[:2]).all()
    assert (found.log_likelihood[:2] == 0.0).all()
    assert found.log_likelihood.sum() == pytest.approx(innovations_of(recording).log_likelihood.sum(), rel=1e-12)
    assert np.isnan(found.value[:, 0]).sum() == len(np.unique(ids)) + 1


def test_unsuitable_recordings_are_refused():
    recording = recording_of()
    with pytest.raises(UserError, match="landmark: a log without ids"):
        Log(replace(recording, landmark=None))
    with pytest.raises(UserError, match="sensor: a first bearing does not place a landmark"):
        Log(bearing_only(recording))


def test_the_result_is_none_if_no_update_exists():
    recording = recording_of()
    none = np.full_like(recording.observation_cov, np.nan)
    given = (recording.odometry, recording.odometry_cov, recording.observation, none)
    assert Log(recording).innovations(*given) is None


def test_kernels_are_compiled_once_for_all_layouts_of_arrays():
    recording = recording_of("trajectory.duration=2")
    innovations_of(recording)
    given = (recording.odometry, recording.odometry_cov, recording.observation, recording.observation_cov)
    for laid_out in (np.array, np.asfortranarray):
        increments, their_cov, seen, its_cov = map(laid_out, given)
        Log(recording).innovations(increments, their_cov, seen, its_cov)
    assert len(cast("Dispatcher", _run).signatures) == 1
