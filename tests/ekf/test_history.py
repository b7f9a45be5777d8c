"""History of an estimate: the map at some steps, and the log of rays."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge import load_scenario, simulate
from slamgauge.ekf import (
    BearingFilter,
    Delayed,
    FilterSettings,
    Rays,
    ekf_slam,
    riekf,
)
from slamgauge.ekf.bearings.rays import distances_and_sigmas
from slamgauge.ekf.estimators import drive, steps_of_frames
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.settings import Initialisation
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Observations, Recording
from tests.reference.given import given
from tests.reference.random_recordings import random_recording

INITIALISATIONS = pytest.mark.parametrize("initialisation", [Rays(), Delayed()], ids=["rays", "delayed"])


def ring() -> Recording:
    return simulate(load_scenario("q4-ring", ["start=sampled", "trajectory.duration=25"]), 0)[1]


def history_of(estimate: Estimate) -> MapHistory:
    return given(estimate.history)


def rays_of(estimate: Estimate) -> RayLog:
    return given(estimate.rays)


# --- frames --------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [*range(12), 40, 41])
def test_frames_are_spread_evenly_from_first_to_last(steps: int) -> None:
    for frames in (1, 2, 3, 5, 6, 12, 14, 41, 1000):
        kept = np.sort([*steps_of_frames(steps, frames)])
        assert len(kept) == min(frames, steps + 1)
        assert kept[0] == 0
        assert frames == 1 or kept[-1] == steps
        assert np.ptp(np.diff(kept)) <= 1 if len(kept) > 2 else True


@pytest.mark.parametrize("bearing", [False, True])
def test_without_frames_there_is_no_history_and_frames_change_nothing_else(bearing: bool) -> None:
    """The last map of the history is that of the estimate."""
    recording = ring() if bearing else random_recording(0)[1]
    without, with_frames = ekf_slam(recording), ekf_slam(recording, FilterSettings(frames=20))
    assert (without.history, without.rays is not None) == (None, bearing)
    history = history_of(with_frames)
    last = (history.step == recording.steps) & (history.member == NONE)
    np.testing.assert_array_equal(
        history.position[last], without.landmarks[np.isin(without.landmark_ids, history.landmark[last])]
    )
    nothing = recording.only(np.zeros(len(recording.observation), dtype=bool))
    assert len(history_of(ekf_slam(nothing, FilterSettings(frames=5))).step) == 0
    np.testing.assert_array_equal(with_frames.poses, without.poses)
    np.testing.assert_array_equal(with_frames.landmarks, without.landmarks)


# --- maps ----------------------------------------------------------------------------------------


@INITIALISATIONS
def test_members_are_those_of_the_filter_at_that_step(initialisation: Initialisation) -> None:
    """Weights of a ray have sum one; the filter reports its heaviest member, and every point."""
    recording = ring()
    history = history_of(riekf(recording, FilterSettings(initialisation=initialisation, frames=recording.steps + 1)))
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, "right-invariant", initialisation)
    rays, points = 0, 0
    for step, _ in enumerate(drive(slam, recording)):
        rows = np.flatnonzero(history.step == step)
        member, landmark, weight = history.member[rows], history.landmark[rows], history.weight[rows]
        for name, position in zip(slam.landmark_ids.tolist(), slam.landmarks, strict=True):
            mine = rows[landmark == name]
            np.testing.assert_array_equal(history.position[mine[np.argmax(history.weight[mine])]], position)
            if name in slam.provisional:
                assert len(mine) == slam.provisional[name]
                assert (np.diff(history.member[mine]) > 0).all()
                assert history.weight[mine].sum() == pytest.approx(1.0, abs=1e-12)
                rays += 1
            else:
                assert history.member[mine].tolist() == [NONE]
                assert history.weight[mine].tolist() == [1.0]
                points += 1
        assert {*landmark.tolist()} == {*slam.landmark_ids.tolist()}
        assert (member >= 0).sum() == slam.member_count == sum(slam.provisional.values())
        assert (weight > 0.0).all()
    assert points > 50
    assert rays > 50 or isinstance(initialisation, Delayed)


# --- the log of rays -----------------------------------------------------------------------------


def test_the_log_agrees_with_the_maps() -> None:
    """Birth: first map with the ray. End: first map without it. Survivor: number of the last member."""
    recording, rays = ring(), Rays()
    estimate = ekf_slam(recording, FilterSettings(initialisation=rays, frames=recording.steps + 1))
    log, history = rays_of(estimate), history_of(estimate)
    counted = [((history.step == step) & (history.member >= 0)).sum() for step in range(recording.steps + 1)]
    np.testing.assert_array_equal(log.members, counted)
    assert len(log.members) == recording.steps + 1
    outcomes = {"point": 0, "lost": 0, "ray": 0}
    for row, name in enumerate(log.landmark.tolist()):
        end = int(log.end[row])
        alive = (history.landmark == name) & (history.step >= log.birth[row])
        as_ray = alive & (history.member >= 0) & ((end < 0) | (history.step < end))
        steps = np.unique(history.step[as_ray])
        last = end - 1 if end >= 0 else recording.steps
        assert steps.tolist() == [*range(int(log.birth[row]), last + 1)]
        distances = log.distances[row][np.isfinite(log.distances[row])]
        assert history.member[as_ray & (history.step == log.birth[row])].tolist() == [*range(len(distances))]
        np.testing.assert_array_equal(distances, distances_and_sigmas(rays)[0])
        if log.survivor[row] >= 0:
            assert log.survivor[row] in history.member[as_ray & (history.step == last)]
            assert history.member[alive & (history.step == end)].tolist() == [NONE]
            outcomes["point"] += 1
        else:
            outcomes["ray" if end < 0 else "lost"] += 1
    assert outcomes["point"] > 5
    assert {*log.landmark.tolist()} >= {*np.asarray(estimate.landmark_ids).tolist()}
    assert sum(outcomes.values()) == len(log.landmark)


def test_a_landmark_that_starts_twice_has_two_rows() -> None:
    """The second bearing fails the gate of the first ray, which is deleted; the last ray still exists."""
    slam = BearingFilter(np.zeros(3), np.zeros((3, 3)), initialisation=Rays(lost_after=1))
    for landmark, bearing in ((7, 0.0), (8, 0.0), (7, 1.0)):
        slam.predict(np.zeros(3), np.zeros((3, 3)))
        slam.update(Observations(np.array([landmark]), np.array([[bearing]]), np.array([[[1e-4]]])))
    log = slam.ray_log(np.arange(4))
    assert log is not None
    assert log.landmark.tolist() == [7, 8, 7]
    assert log.birth.tolist() == [1, 2, 3]
    assert log.end.tolist() == [3, -1, -1]
    assert log.survivor.tolist() == [-1, -1, -1]
    np.testing.assert_array_equal(log.distances, np.tile(distances_and_sigmas(Rays())[0], (3, 1)))
    np.testing.assert_array_equal(log.members, np.arange(4))
    assert slam.landmark_ids.tolist() == [8, 7]
