"""Maps at a step: their contents, the scene of animations, and the strip of rays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from slamgauge import arrays, load_scenario, simulate
from slamgauge.compare.figures.map_contents import NEVER, first_seen, map_at, sight_lines
from slamgauge.compare.figures.map_layers import FAINTEST, MapLayer
from slamgauge.compare.figures.ray_strip import has_rays, ray_frames, save_ray_strip
from slamgauge.compare.figures.scene import Scene
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import Estimate, MapHistory, RayLog
from tests.reference.example_rays import AGES, BIRTHS, LANDMARKS, NOTED, STEPS, Fate, estimate_with_rays, half_loop

TRUTH, RECORDING = half_loop()
WITH_RAYS = estimate_with_rays()
NO_HISTORY = replace(WITH_RAYS, rays=None, history=None)
SMOOTHED = replace(NO_HISTORY, kind="smoothed")
SPARSE = RECORDING.only(RECORDING.observation_step == 85)


def history_of(estimate: Estimate) -> MapHistory:
    assert estimate.history is not None
    return estimate.history


# --- the map at a step -------------------------------------------------------------------------


def test_the_map_is_the_last_recorded_one_and_empty_before():
    history = history_of(WITH_RAYS)
    gap = int(np.setdiff1d(np.arange(STEPS), NOTED)[-1])
    for step, noted in ((0, 0), (int(NOTED[7]), int(NOTED[7])), (gap, gap - 1), (STEPS, STEPS)):
        rows = map_at(WITH_RAYS, step)
        np.testing.assert_array_equal(rows.position, history.position[history.step == noted])
        np.testing.assert_array_equal(rows.member, history.member[history.step == noted])
    late = history.step >= 10
    later = MapHistory(*(getattr(history, name)[late] for name in MapHistory.__dataclass_fields__))
    assert len(map_at(replace(WITH_RAYS, history=later), 9).weight) == 0


def test_a_ray_lost_since_the_last_record_is_not_in_the_map_and_a_new_one_is():
    estimate, end = estimate_with_rays(("lost",)), BIRTHS[0] + AGES[-1]
    assert [len(map_at(estimate, step).weight) for step in (end - 1, end)] == [2, 0]
    columns = ([0, 0], [0, end], [end, -1], [-1, -1])
    log = RayLog(
        *(np.array(column) for column in columns),
        distances=np.full((2, 4), np.nan),
        members=np.zeros(STEPS + 1, np.int64),
    )
    assert end in NOTED
    assert len(map_at(replace(estimate_with_rays(("ray",)), rays=log), end).weight) == 2


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


def test_lines_of_sight_connect_the_robot_with_the_landmarks_of_the_last_scan():
    lines = sight_lines(RECORDING, NO_HISTORY, 80, 90)
    np.testing.assert_array_equal(lines[:, 0], np.tile(NO_HISTORY.poses[90, :2], (3, 1)))
    np.testing.assert_array_equal(lines[:, 1], LANDMARKS + 0.2)
    assert len(sight_lines(replace(RECORDING, landmark=None), NO_HISTORY, 80, 90)) == 0
    assert sight_lines(SPARSE, NO_HISTORY, 80, 90)[0, 0].tolist() == NO_HISTORY.poses[85, :2].tolist()
    assert len(sight_lines(SPARSE, NO_HISTORY, 90, 100)) == 0  # a scan is shown once


# --- the scene ---------------------------------------------------------------------------------


def scene_of(estimates: dict[str, Estimate], mapped: list[str]) -> tuple[Scene, Figure]:
    figure = Figure()
    results = Results("a title", TRUTH, RECORDING, estimates)
    return Scene(figure.subplots(), results, estimates, {name: estimates[name] for name in mapped}), figure


def lines_of(figure: Figure, color: str) -> list[Line2D]:
    lines = [line for line in figure.axes[0].lines if line.get_color() == color]
    return [line for line in lines if len(np.asarray(line.get_xdata()))]


def test_paths_end_where_the_robots_are():
    scene, figure = scene_of({"ekf": WITH_RAYS, "batch": SMOOTHED}, ["ekf"])
    for step in (10, 200):
        scene.show(step)
        for color, poses in (("#CC3311", WITH_RAYS.poses), ("#882288", SMOOTHED.poses)):
            np.testing.assert_array_equal(lines_of(figure, color)[0].get_xydata(), poses[: step + 1, :2])
        patches = [each for each in figure.axes[0].patches if isinstance(each, Polygon)]
        (robot,) = (each for each in patches if each.get_facecolor() == to_rgba("#CC3311"))
        nose = np.asarray(robot.get_xy())[0] - WITH_RAYS.poses[step, :2]
        assert np.arctan2(nose[1], nose[0]) == pytest.approx(WITH_RAYS.poses[step, 2])


def test_the_map_comes_from_the_history_or_from_the_final_map():
    scene, figure = scene_of({"ekf": WITH_RAYS, "causal": NO_HISTORY}, ["ekf", "causal"])
    scene.show(30)
    ellipses = [each for each in figure.axes[0].collections if isinstance(each, EllipseCollection)]
    shown = [len(np.asarray(each.get_offsets())) for each in ellipses]
    assert sorted(shown) == [0, 0, 1, 1, 5]  # points; true robot; two robots; members of two rays
    np.testing.assert_array_equal(lines_of(figure, "#CC9900")[1].get_xydata(), LANDMARKS[:2] + 0.2)
    (sight,) = (each for each in figure.axes[0].collections if isinstance(each, LineCollection))
    assert len(sight.get_segments()) == 2
    scene.show(BIRTHS[2])
    np.testing.assert_array_equal(lines_of(figure, "#CC9900")[1].get_xydata(), LANDMARKS + 0.2)


def test_opacity_of_members_grows_with_their_weight():
    rows, ax = map_at(WITH_RAYS, 12), Figure().subplots()
    layer = MapLayer(ax, "#CC3311")
    layer.show(rows)
    points, members = ax.collections
    assert len(np.asarray(points.get_offsets())) == 0
    np.testing.assert_array_equal(members.get_offsets(), rows.position)
    assert np.asarray(members.get_edgecolor())[:, 3] == pytest.approx(FAINTEST + (1 - FAINTEST) * rows.weight)
    layer.show(map_at(WITH_RAYS, STEPS))
    assert [len(np.asarray(each.get_offsets())) for each in (points, members)] == [3, 0]


# --- the strip of rays -------------------------------------------------------------------------


def test_the_strip_follows_the_oldest_ray_that_became_a_point():
    frames = ray_frames(WITH_RAYS)
    assert [frame.step for frame in frames] == [0, 12, 26, 30, 70, 130]
    assert {frame.landmark for frame in frames} == {0}
    assert [frame.caption for frame in frames] == [
        "1 ray; landmark 0: 4 members",
        "2 rays; landmark 0: 3 members",
        "2 rays; landmark 0: 3 members",
        "2 rays; landmark 0: 2 members",
        "2 rays; landmark 0: a point",
        "0 rays; landmark 0: a point",
    ]


@pytest.mark.parametrize("fates", [("ray", "ray", "ray"), ("lost",), ("lost", "ray", "point"), ("ray",), ("point",)])
def test_every_strip_has_six_moments_in_order(fates: tuple[Fate, ...]):
    steps = [frame.step for frame in ray_frames(estimate_with_rays(fates))]
    assert steps == sorted(set(steps))
    assert (len(steps), steps[0]) == (6, 0)


def test_few_records_give_few_moments():
    estimate = estimate_with_rays(("ray", "ray", "ray"))
    history = history_of(estimate)
    kept = np.isin(history.step, [0, STEPS])
    short = MapHistory(*(getattr(history, name)[kept] for name in MapHistory.__dataclass_fields__))
    assert [frame.step for frame in ray_frames(replace(estimate, history=short))] == [0, STEPS]


def test_rays_need_a_log_and_a_history():
    none = np.zeros(0, np.int64)
    no_ray = replace(WITH_RAYS, rays=RayLog(none, none, none, none, np.zeros((0, 4)), np.zeros(STEPS + 1, np.int64)))
    assert [has_rays(each) for each in (NO_HISTORY, no_ray, WITH_RAYS)] == [False, False, True]


@pytest.mark.parametrize("blind", [False, True])
def test_all_panels_show_the_same_map(tmp_path: Path, drawn: dict[str, Figure], blind: bool):
    save_ray_strip(tmp_path, Results("a", None if blind else TRUTH, RECORDING, {"ekf": WITH_RAYS}), "ekf")
    panels = drawn["rays"].axes
    assert len(panels) == 6
    assert len({(*panel.get_xlim(), *panel.get_ylim(), panel.get_aspect()) for panel in panels}) == 1
    (left, right), (bottom, top) = panels[0].get_xlim(), panels[0].get_ylim()
    places = np.concatenate([WITH_RAYS.poses[:131, :2], LANDMARKS])
    assert left < places[:, 0].min() < places[:, 0].max() < right
    assert bottom < places[:, 1].min() < places[:, 1].max() < top
    assert panels[4].get_title() == "t = 7.0 s\n2 rays; landmark 0: a point"
    assert [text.get_text() for text in panels[4].texts] == ["0"]
