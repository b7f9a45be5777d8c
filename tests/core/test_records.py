"""Valid records: missing fields, gaps, parts of a recording, and arrays that records share or copy."""

from __future__ import annotations

import gc
import math
import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from slamgauge import Estimate, arrays, evaluate, load_scenario, simulate
from slamgauge.compare.figures.maps import map_limits
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.se2 import chain
from slamgauge.truth import Truth
from slamgauge.validation import as_covariances, as_floats, as_ints
from tests.reference.example_records import estimate, recording, truth

STEPS = 4000
OVERRIDES = [f"trajectory.duration={STEPS / 10}"]


# --- fields --------------------------------------------------------------------------------------


def test_fields_of_records_may_be_missing() -> None:
    least = Estimate(kind="smoothed", poses=np.zeros((3, 3)))
    assert (least.landmark_ids.shape, least.landmarks.shape) == ((0,), (0, 2))
    assert (least.pose_covs, least.association) == (None, None)
    assert [getattr(Truth(), field.name) for field in fields(Truth)] == [None] * 5
    assert truth(landmark_ids=None, landmarks=None, association=[7, 7]).association is not None
    none = truth(landmark_ids=[], landmarks=np.zeros((0, 2)), association=[])
    assert np.asarray(none.landmarks).shape == (0, 2)


def test_a_truth_may_have_gaps_and_positions_without_headings() -> None:
    with_gap = truth(poses=[[0, 0, 4.0], [math.nan] * 3, [1, 1, -4.0]]).poses
    np.testing.assert_allclose(np.asarray(with_gap)[:, 2], [4.0 - 2 * math.pi, math.nan, 2 * math.pi - 4.0])
    poses = np.array([[0.0, 0.0, np.nan], [1.0, 0.0, np.nan], [np.nan, np.nan, np.nan]])
    np.testing.assert_array_equal(Truth(poses=poses).poses, poses)


def test_figures_of_an_optimum_are_plain_numbers() -> None:
    optimum = estimate(chi_square=np.float64(12.5), chi_square_dof=np.array(10), optimum_check=np.float64("inf"))
    assert (type(optimum.chi_square), type(optimum.chi_square_dof), type(optimum.optimum_check)) == (float, int, float)
    assert optimum == estimate(chi_square=12.5, chi_square_dof=10, optimum_check=math.inf)


@pytest.mark.parametrize("sensor", ["range-bearing", "bearing", "position"])
def test_a_recording_may_have_no_observations_and_no_steps(sensor: str) -> None:
    dim = 1 if sensor == "bearing" else 2
    nothing = {"odometry": np.zeros((0, 3)), "odometry_cov": np.zeros((0, 3, 3)), "observation_step": []}
    seen = {"observation": np.zeros((0, dim)), "observation_cov": np.zeros((0, dim, dim)), "landmark": []}
    empty = recording(stamps=[5.0], sensor=sensor, **nothing, **seen)
    assert empty.steps == 0
    assert [len(scan.value) for scan in empty.scans()] == [0]


# --- parts ---------------------------------------------------------------------------------------


def test_scans_come_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    scans = list(recording(observation_step=[0, 2, 2]).scans())
    assert [np.asarray(scan.landmark).tolist() for scan in scans] == [[4], [], [4, 9]]
    np.testing.assert_array_equal(scans[2].value, [[3.0, -0.2], [1.0, 3.1]])
    assert scans[2].cov.shape == (2, 2, 2)
    assert [scan.landmark for scan in recording(landmark=None).scans()] == [None, None, None]
    monkeypatch.setattr(arrays, "CHUNK", 2)
    assert [len(scan.value) for scan in recording(observation_step=[0, 2, 2]).scans()] == [1, 0, 2]


def test_the_first_steps_and_chosen_observations_are_recordings() -> None:
    whole = recording(observation_step=[0, 1, 2])
    for steps in range(3):
        part = whole.first(steps)
        assert part.steps == steps
        np.testing.assert_array_equal(part.stamps, whole.stamps[: steps + 1])
        np.testing.assert_array_equal(part.odometry_cov, whole.odometry_cov[:steps])
        assert part == part.only(part.observation_step <= steps)
        assert len(part.observation) == steps + 1
    kept = whole.only(np.array([True, False, True]))
    for name in ("observation_step", "observation", "observation_cov", "landmark"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(whole, name)[[0, 2]])
    assert recording(landmark=None).first(1).only(np.zeros(3, dtype=bool)).landmark is None


# --- shared and copied arrays --------------------------------------------------------------------


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


def test_headings_are_wrapped_in_a_copy_of_read_only_poses() -> None:
    poses = np.array([[0.0, 0.0, 7.0], [0.0, 0.0, -math.pi], [0.0, 0.0, 1.0]])
    poses.setflags(write=False)
    wrapped = Estimate(kind="filtered", poses=poses)
    np.testing.assert_allclose(wrapped.poses[:, 2], [7.0 - 2 * math.pi, math.pi, 1.0], rtol=1e-15)
    assert poses[0, 2] == 7.0
    assert np.shares_memory(replace(wrapped, poses=wrapped.poses).poses, wrapped.poses)


# --- memory --------------------------------------------------------------------------------------


def test_memory_of_a_long_run_is_that_of_its_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """`docs/limits.md` states the bytes: 32 and 32 for a recording, 24 for the truth, 120 for an estimate."""
    monkeypatch.setattr(arrays, "CHUNK", 500)
    scenario = load_scenario("q1-long-dense", OVERRIDES)
    true, log = simulate(load_scenario("q1-long-dense", ["trajectory.duration=80"]), 0)
    evaluate(true, log, ekf_slam(log))  # loads modules first
    (true, log), kept, peak = _traced(lambda: simulate(scenario, 0))
    observations = len(log.observation)
    assert kept == pytest.approx(STEPS * (32 + 24) + observations * 32, rel=0.05)
    assert peak < kept + observations * 24 + 3e6  # three arrays of observations, and one chunk
    found, kept, peak = _traced(lambda: ekf_slam(log))
    assert kept == pytest.approx(STEPS * 120, rel=0.1)
    assert found.association is log.landmark
    assert peak < kept + observations * 8 + 1e5  # no second array of ids
    score, kept, peak = _traced(lambda: evaluate(true, log, found))
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


@pytest.mark.slow
def test_results_do_not_depend_on_the_size_of_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    clutter = ["sensor.clutter_rate=0.3", "trajectory.duration=80"]
    for overrides in (clutter, [*clutter, "association.method=nearest-neighbour"]):
        scenario = load_scenario("q1-long-dense", overrides)
        whole, parts = _results(scenario), []
        with monkeypatch.context() as patched:
            patched.setattr(arrays, "CHUNK", 7)
            parts = _results(scenario)
        assert parts == whole
        assert whole[-1]["loop_closure"]


def _results(scenario: Any) -> list[Any]:
    """Return recording, truth, estimate and scores, without times."""
    true, log = simulate(scenario, 1)
    found = ekf_slam(log)
    scores = evaluate(true, log, found).to_json().items()
    timeless = {key: value for key, value in scores if not key.startswith("seconds")}
    return [true, log, replace(found, seconds=None), timeless]


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
