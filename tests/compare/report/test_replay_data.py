"""The data of a replay agree with the run."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest

from slamgauge import compare_estimators, load_estimators, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.compare.figures.maps import map_at
from slamgauge.compare.report.page import KINDS, looks
from slamgauge.compare.report.replay_data import frame_steps, replay_data, shown_observations
from slamgauge.compare.storage.files import Results

pytestmark = pytest.mark.slow


def unpacked(packed: dict[str, Any]) -> Float:
    return np.frombuffer(base64.b64decode(packed["data"]), dtype=KINDS[packed["kind"]])


@pytest.fixture(scope="module")
def results() -> Results:
    """A run of 20 s without ids, at a gate that accepts wrong associations."""
    settings = ["trajectory.duration=20", "association.gate=100", "trajectory.yaw_rate=0.6"]
    scenario = load_scenario("q2-short-dense", settings)
    truth, recording = simulate(scenario, 0)
    estimators = load_estimators(["ekf", "riekf"], scenario.association, frames=40)
    return Results("a run", truth, recording, compare_estimators(truth, recording, estimators).estimates)


@pytest.mark.parametrize("count", [201, 40, 2])
def test_a_frame_has_the_last_scan_since_the_frame_before_at_its_measured_places(results: Results, count: int):
    recording = results.recording
    shown = frame_steps(recording.steps, count)
    observations = shown_observations(recording, shown, 1.0)
    before = -1
    for frame, step in enumerate(shown.tolist()):
        since = recording.observation_step[(recording.observation_step > before) & (recording.observation_step <= step)]
        expected = np.flatnonzero(recording.observation_step == since.max()) if len(since) else []
        found = observations.observation[observations.start[frame] : observations.start[frame + 1]]
        np.testing.assert_array_equal(found, expected)
        before = step
    ranges, bearings = recording.observation[observations.observation].T
    np.testing.assert_allclose(observations.body.T, ranges * [np.cos(bearings), np.sin(bearings)], atol=1e-12)


def test_maps_errors_and_nees_are_those_of_the_estimates(results: Results):
    data = replay_data(results, looks(results.estimates), 10_000_000)
    assert results.truth is not None and results.truth.poses is not None
    for packed, estimate in zip(data["estimates"], results.estimates.values(), strict=True):
        rows = packed["rows"]
        map_of, start = unpacked(rows["mapAt"]), unpacked(rows["start"])
        places = unpacked(rows["place"]).reshape(-1, 2)
        for frame in range(0, results.recording.steps + 1, 7):
            at = int(map_of[frame])
            found = places[int(start[at]) : int(start[at + 1])] if at >= 0 else places[:0]
            np.testing.assert_allclose(found, map_at(estimate, frame).position, rtol=1e-6)
        expected = np.linalg.norm(estimate.poses[:, :2] - results.truth.poses[:, :2], axis=1)
        np.testing.assert_allclose(unpacked(packed["error"]), expected, rtol=1e-5, atol=1e-6)
        assert np.isfinite(unpacked(packed["nees"])).any()


def test_a_replay_has_as_many_frames_as_the_size_limit_allows(results: Results):
    whole = replay_data(results, looks(results.estimates), 10_000_000)
    assert len(unpacked(whole["step"])) == results.recording.steps + 1
    room = len(json.dumps(whole)) // 2
    half = replay_data(results, looks(results.estimates), room)
    steps = unpacked(half["step"])
    assert len(json.dumps(half)) <= room and 30 <= len(steps) < results.recording.steps + 1
    assert (steps[0], steps[-1]) == (0, results.recording.steps)
