"""The scene of an animation: its contents at a step."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from slamgauge import arrays, load_scenario, simulate
from slamgauge.compare.figures.animation_scene import Scene
from slamgauge.compare.figures.map_contents import NEVER, first_seen, sight_lines
from slamgauge.compare.storage.stored_results import Results
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from tests.reference.example_rays import BIRTHS, LANDMARKS, estimate_with_rays, half_loop

TRUTH, RECORDING = half_loop()
assert TRUTH.poses is not None
assert TRUTH.association is not None
POSES = TRUTH.poses
WITH_RAYS = estimate_with_rays()
NO_HISTORY = replace(WITH_RAYS, rays=None, history=None)
SMOOTHED = replace(NO_HISTORY, kind="smoothed")
KEPT = RECORDING.observation_step == 85
SPARSE, SPARSE_TRUTH = RECORDING.only(KEPT), replace(TRUTH, association=TRUTH.association[KEPT])


# --- observed landmarks ------------------------------------------------------------------------


def test_first_seen_is_the_step_of_the_first_observation():
    assert first_seen(RECORDING, NO_HISTORY).tolist() == [*BIRTHS]
    nameless = replace(RECORDING, landmark=None)
    assert first_seen(nameless, NO_HISTORY).tolist() == [0, 0, 0]
    given = np.full(len(RECORDING.observation), -1)
    given[RECORDING.observation_step >= 100] = 1
    assert first_seen(nameless, replace(NO_HISTORY, association=given)).tolist() == [NEVER, 100, NEVER]


def test_first_seen_does_not_depend_on_the_chunk_size(monkeypatch: pytest.MonkeyPatch):
    """Without chunks a run of a million steps needs half a gigabyte."""
    recording = simulate(load_scenario("q1-long-dense", ["trajectory.duration=20"]), 0)[1]
    assert recording.landmark is not None
    ids = np.arange(40)
    places = Estimate(kind="filtered", poses=np.zeros((201, 3)), landmark_ids=ids, landmarks=np.zeros((40, 2)))
    observed = [recording.observation_step[recording.landmark == each] for each in ids]
    expected = [int(steps[0]) if len(steps) else NEVER for steps in observed]
    assert NEVER in expected
    for size in (7, len(recording.landmark)):
        monkeypatch.setattr(arrays, "CHUNK", size)
        assert first_seen(recording, places).tolist() == expected
    monkeypatch.setattr(arrays, "CHUNK", 50)
    tracemalloc.start()
    first_seen(recording, places)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < len(recording.landmark) * len(ids) / 2


def test_lines_of_sight_connect_the_robot_with_observed_landmarks():
    lines = sight_lines(TRUTH, RECORDING, NO_HISTORY, 80, 90)
    np.testing.assert_array_equal(lines[:, 0], np.tile(POSES[90, :2], (3, 1)))
    np.testing.assert_array_equal(lines[:, 1], LANDMARKS)
    blind = sight_lines(Truth(), RECORDING, NO_HISTORY, 80, 90)
    np.testing.assert_array_equal(blind[:, 0], np.tile(NO_HISTORY.poses[90, :2], (3, 1)))
    np.testing.assert_array_equal(blind[:, 1], LANDMARKS + 0.2)
    assert len(sight_lines(Truth(), replace(RECORDING, landmark=None), NO_HISTORY, 80, 90)) == 0


def test_a_scan_between_two_frames_is_shown_once():
    assert sight_lines(SPARSE_TRUTH, SPARSE, NO_HISTORY, 80, 90)[0, 0].tolist() == POSES[85, :2].tolist()
    assert len(sight_lines(SPARSE_TRUTH, SPARSE, NO_HISTORY, 90, 100)) == 0


# --- the scene ---------------------------------------------------------------------------------


def scene_of(estimates: dict[str, Estimate], mapped: list[str]) -> Scene:
    results = Results("a title", TRUTH, RECORDING, estimates)
    return Scene(results, estimates, {name: estimates[name] for name in mapped})


def lines_of(scene: Scene, color: str) -> list[Line2D]:
    return [
        line for line in scene.figure.axes[0].lines if line.get_color() == color and len(np.asarray(line.get_xdata()))
    ]


def test_paths_end_where_the_robots_are():
    scene = scene_of({"ekf": WITH_RAYS, "batch": SMOOTHED}, ["ekf"])
    for step in (10, 200):
        scene.show(step)
        for color, poses in (("#CC3311", WITH_RAYS.poses), ("#882288", SMOOTHED.poses)):
            path = lines_of(scene, color)[0]
            np.testing.assert_array_equal(path.get_xydata(), poses[: step + 1, :2])
        patches = [each for each in scene.figure.axes[0].patches if isinstance(each, Polygon)]
        (robot,) = (each for each in patches if each.get_facecolor() == to_rgba("#CC3311"))
        nose = np.asarray(robot.get_xy())[0] - WITH_RAYS.poses[step, :2]
        assert np.arctan2(nose[1], nose[0]) == pytest.approx(WITH_RAYS.poses[step, 2])


def test_the_map_comes_from_the_history_or_from_the_final_map():
    scene = scene_of({"ekf": WITH_RAYS, "causal": NO_HISTORY}, ["ekf", "causal"])
    scene.show(30)
    shown = [
        len(np.asarray(each.get_offsets()))
        for each in scene.figure.axes[0].collections
        if isinstance(each, EllipseCollection)
    ]
    assert sorted(shown) == [0, 0, 1, 1, 5]  # points; true robot; two robots; members of two rays
    np.testing.assert_array_equal(lines_of(scene, "#CC9900")[1].get_xydata(), LANDMARKS[:2] + 0.2)
    scene.show(BIRTHS[2])
    np.testing.assert_array_equal(lines_of(scene, "#CC9900")[1].get_xydata(), LANDMARKS + 0.2)


@pytest.mark.parametrize(
    ("truth", "recording", "frames"),
    [(TRUTH, RECORDING, {0: 1, 90: 3}), (SPARSE_TRUTH, SPARSE, {80: 0, 90: 3, 100: 0})],
)
def test_the_time_and_the_lines_of_sight_move(truth: Truth, recording: Recording, frames: dict[int, int]):
    """A scan of the sparse recording is not shown again in later frames."""
    shown = {"causal": NO_HISTORY}
    scene = Scene(Results("a title", truth, recording, shown), shown, shown)
    (sight,) = (each for each in scene.figure.axes[0].collections if isinstance(each, LineCollection))
    for step, lines in frames.items():
        scene.show(step)
        assert [text.get_text() for text in scene.figure.texts] == [f"t = {step / 10:.1f} s"]
        assert len(sight.get_segments()) == lines


def test_scales_are_equal_and_limits_contain_everything():
    ax = scene_of({"ekf": WITH_RAYS}, ["ekf"]).figure.axes[0]
    box = ax.get_window_extent()
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert (right - left) / box.width == pytest.approx((top - bottom) / box.height)
    places = np.concatenate([WITH_RAYS.poses[:, :2], LANDMARKS])
    assert left < places[:, 0].min() < places[:, 0].max() < right
    assert bottom < places[:, 1].min() < places[:, 1].max() < top
