"""Arrays that records share or copy, and the memory of a long run."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slamgauge import Estimate, Recording, arrays, evaluate, load_scenario, simulate
from slamgauge.compare.figures.maps import map_limits
from slamgauge.compare.scenarios.simulation import informed, simulate_informed
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.se2 import chain
from slamgauge.validation import as_covariances, as_floats, as_ints

STEPS = 4000
OVERRIDES = [f"trajectory.duration={STEPS / 10}"]


@pytest.mark.parametrize("take", [as_floats, as_ints])
def test_read_only_arrays_are_shared_and_others_copied(take: Callable[..., Any]) -> None:
    given = np.arange(5, dtype=np.int64 if take is as_ints else np.float64)
    view = given[1:]
    view.setflags(write=False)
    for open_to_writing in (given, view):
        assert not np.shares_memory(take("value", open_to_writing, (None,)), given)
    given.setflags(write=False)
    for closed in (given, given[1:]):
        assert np.shares_memory(take("value", closed, (None,)), given)
    assert take("value", given[::2], (None,)).flags.c_contiguous


def test_a_covariance_for_all_rows_is_stored_once() -> None:
    one = np.diag([1.0, 2.0])
    for given in (np.tile(one, (9, 1, 1)), np.broadcast_to(one, (9, 2, 2))):
        kept = as_covariances("cov", given, (9, 2, 2))
        assert kept.strides[0] == 0
        assert not kept.flags.writeable
        np.testing.assert_array_equal(kept, given)
    one[0, 0] = 7.0
    assert kept[3, 0, 0] == 1.0
    several = np.tile(one, (9, 1, 1))
    several[8, 0, 0] = 3.0
    assert as_covariances("cov", several, (9, 2, 2)).strides[0] > 0


def test_headings_of_read_only_poses_are_wrapped_in_a_copy() -> None:
    poses = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 1.0]])
    poses.setflags(write=False)
    estimate = Estimate(kind="filtered", poses=poses)
    np.testing.assert_allclose(estimate.poses[:, 2], [4.0 - 2 * np.pi, 1.0], rtol=1e-15)
    assert poses[0, 2] == 4.0
    assert np.shares_memory(replace(estimate, poses=estimate.poses).poses, estimate.poses)


def test_informed_recordings_share_unchanged_arrays() -> None:
    for name in ("q2-gate-1", "q3-scale-2"):
        scenario = load_scenario(name, ["trajectory.duration=3", "sensor.clutter_rate=0.5"])
        truth, recording, told = simulate_informed(scenario, 3)
        assert (truth, recording) == simulate(scenario, 3)
        assert told == simulate(informed(scenario), 3)[1]
        assert told != recording
        assert np.shares_memory(recording.observation, told.observation)


def test_memory_of_a_long_run_is_that_of_its_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """`docs/limits.md` states the bytes: 32 and 32 for a recording, 24 for the truth, 120 for an estimate."""
    monkeypatch.setattr(arrays, "CHUNK", 500)
    scenario = load_scenario("q1-long-dense", OVERRIDES)
    truth, recording = simulate(load_scenario("q1-long-dense", ["trajectory.duration=3"]), 0)
    evaluate(truth, recording, ekf_slam(recording))  # loads modules first
    (truth, recording), kept, peak = _traced(lambda: simulate(scenario, 0))
    observations = len(recording.observation)
    assert kept == pytest.approx(STEPS * (32 + 24) + observations * 32, rel=0.05)
    assert peak < kept + observations * 24 + 3e6  # three arrays of observations, and one chunk
    estimate, kept, peak = _traced(lambda: ekf_slam(recording))
    assert kept == pytest.approx(STEPS * 120, rel=0.1)
    assert estimate.association is recording.landmark
    assert peak < kept + observations * 8 + 1e5  # no second array of ids
    score, kept, peak = _traced(lambda: evaluate(truth, recording, estimate))
    assert kept < STEPS * 33 + len(score["loop_closure"]) * 300  # NEES and sigmas of all steps
    assert peak < kept + STEPS * 90


def test_the_limits_of_a_map_need_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    increments = np.tile([0.1, 0.0, 1e-3], (200_000, 1))
    whole = chain(np.ones(3), increments)
    monkeypatch.setattr(arrays, "CHUNK", 500)
    path, kept, peak = _traced(lambda: chain(np.ones(3), increments))
    np.testing.assert_array_equal(path, whole)
    assert kept == pytest.approx(len(path) * 24, rel=0.01)
    assert peak < kept + len(path) * 8 + 3e5  # headings, and one chunk
    _, kept, peak = _traced(lambda: map_limits([path[:, :2], path[:, :2]], [path[:, :2]]))
    assert peak < 1e5


def test_results_do_not_depend_on_the_size_of_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    clutter = ["sensor.clutter_rate=0.3", "trajectory.duration=80"]
    for overrides in (clutter, [*clutter, "association.method=nearest-neighbour"]):
        truth, recording = simulate(load_scenario("q1-long-dense", overrides), 1)
        whole = ekf_slam(recording)
        scores = evaluate(truth, recording, whole).to_json()
        with monkeypatch.context() as patched:
            patched.setattr(arrays, "CHUNK", 7)
            again = (truth, recording) == simulate(load_scenario("q1-long-dense", overrides), 1)
            part = ekf_slam(recording)
            parts = evaluate(truth, recording, part).to_json()
        assert again
        assert scores["loop_closure"]
        assert replace(part, seconds=None) == replace(whole, seconds=None)
        assert _without_times(parts) == _without_times(scores)


def _without_times(scores: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in scores.items() if not key.startswith("seconds")}


def _traced(work: Callable[[], Any]) -> tuple[Any, int, int]:
    """Return the result of the work, the bytes that it keeps, and its peak memory in bytes."""
    tracemalloc.start()
    try:
        result = work()
        _, peak = tracemalloc.get_traced_memory()
        gc.collect()  # freed tuples, which Python keeps for later use, are not part of the result
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return result, kept, peak


def test_scans_are_read_in_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    recording: Recording = simulate(load_scenario("q1-long-dense", ["trajectory.duration=5"]), 0)[1]
    whole = [scan.value for scan in recording.scans()]
    monkeypatch.setattr(arrays, "CHUNK", 7)
    parts = [scan.value for scan in recording.scans()]
    assert len(parts) == recording.steps + 1
    assert all(map(np.array_equal, parts, whole))
