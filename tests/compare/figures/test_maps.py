"""Maps at a step: their contents, the scene of animations, and the strip of rays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from slamgauge import arrays
from slamgauge.arrays import Float
from slamgauge.compare.figures.frames import caption, has_rays, ray_moments, save_ray_strip
from slamgauge.compare.figures.maps import NEVER, Scene, first_seen, map_at, sight_lines
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import RayLog
from slamgauge.truth import Truth
from tests.reference.example_rays import AGES, BIRTHS, LANDMARKS, NOTED, STEPS, Fate, estimate_with_rays, half_loop

TRUTH, RECORDING = half_loop()
WITH_RAYS = estimate_with_rays()
NO_HISTORY = replace(WITH_RAYS, rays=None, history=None)


def test_the_map_is_the_last_recorded_one_without_rays_lost_since():
    history = WITH_RAYS.history
    assert history is not None
    gap = int(np.setdiff1d(np.arange(STEPS), NOTED)[-1])
    for step, noted in ((0, 0), (int(NOTED[7]), int(NOTED[7])), (gap, gap - 1), (STEPS, STEPS)):
        rows = map_at(WITH_RAYS, step)
        np.testing.assert_array_equal(rows.position, history.position[history.step == noted])
        np.testing.assert_array_equal(rows.member, history.member[history.step == noted])
    estimate, end = estimate_with_rays(("lost",)), BIRTHS[0] + AGES[-1]
    assert [len(map_at(estimate, step).weight) for step in (end - 1, end)] == [2, 0]
    columns = map(np.array, ([0, 0], [0, end], [end, -1], [-1, -1]))  # a new ray begins when the other one is lost
    log = RayLog(*columns, distances=np.full((2, 4), np.nan), members=np.zeros(STEPS + 1, np.int64))
    assert end in NOTED and len(map_at(replace(estimate_with_rays(("ray",)), rays=log), end).weight) == 2


@pytest.mark.parametrize("chunk", [7, arrays.CHUNK])
def test_first_seen_is_the_step_of_the_first_observation(monkeypatch: pytest.MonkeyPatch, chunk: int):
    """Without chunks a run of a million steps needs half a gigabyte."""
    monkeypatch.setattr(arrays, "CHUNK", chunk)
    assert first_seen(RECORDING, NO_HISTORY).tolist() == [*BIRTHS]
    nameless = replace(RECORDING, landmark=None)
    assert first_seen(nameless, NO_HISTORY).tolist() == [0, 0, 0]
    given = np.where(RECORDING.observation_step >= 100, 1, -1)
    assert first_seen(nameless, replace(NO_HISTORY, association=given)).tolist() == [NEVER, 100, NEVER]


def test_lines_of_sight_connect_the_robot_with_the_landmarks_of_the_last_scan():
    lines = sight_lines(RECORDING, NO_HISTORY, 80, 90)
    np.testing.assert_array_equal(lines[:, 0], np.tile(NO_HISTORY.poses[90, :2], (3, 1)))
    np.testing.assert_array_equal(lines[:, 1], LANDMARKS + 0.2)
    assert len(sight_lines(replace(RECORDING, landmark=None), NO_HISTORY, 80, 90)) == 0
    sparse = RECORDING.only(RECORDING.observation_step == 85)
    assert sight_lines(sparse, NO_HISTORY, 80, 90)[0, 0].tolist() == NO_HISTORY.poses[85, :2].tolist()
    assert len(sight_lines(sparse, NO_HISTORY, 90, 100)) == 0  # a scan is shown once


def test_a_scene_ends_paths_at_robots_and_takes_maps_from_the_history_or_the_final_map():
    estimates = {"ekf": WITH_RAYS, "causal": NO_HISTORY, "batch": replace(NO_HISTORY, kind="smoothed")}
    scene = Scene(
        Results("", TRUTH, RECORDING, estimates), estimates, {name: estimates[name] for name in ("ekf", "causal")}
    )
    ax = Figure().subplots()

    def lines(color: str) -> list[Float]:
        found = [np.asarray(line.get_xydata()) for line in ax.lines if line.get_color() == color]
        return [each for each in found if len(each)]

    for step, seen in ((30, 2), (BIRTHS[2], 3)):
        scene.draw(ax, step)
        for color, poses in (("#CC3311", WITH_RAYS.poses), ("#882288", NO_HISTORY.poses)):
            np.testing.assert_array_equal(lines(color)[0], poses[: step + 1, :2])
        (robot,) = (each for each in ax.patches if each.get_facecolor() == to_rgba("#CC3311"))
        nose = np.asarray(robot.get_path().vertices)[0] - WITH_RAYS.poses[step, :2]
        assert np.arctan2(nose[1], nose[0]) == pytest.approx(WITH_RAYS.poses[step, 2])
        np.testing.assert_array_equal(lines("#CC9900")[1], LANDMARKS[:seen] + 0.2)
        (sight,) = (each for each in ax.collections if isinstance(each, LineCollection))
        assert len(sight.get_segments()) == seen
        members = int((map_at(WITH_RAYS, step).member >= 0).sum())
        ellipses = [each for each in ax.collections if isinstance(each, EllipseCollection)]
        assert sorted(len(np.asarray(each.get_offsets())) for each in ellipses) == [0, 1, 1, members]  # and two robots


def test_the_strip_follows_the_oldest_ray_that_became_a_point():
    name, steps = ray_moments(WITH_RAYS)
    assert (name, steps) == (0, [0, 12, 26, 30, 70, 130])
    rays = ("1 ray", "2 rays", "2 rays", "2 rays", "2 rays", "0 rays")
    states = ("4 members", "3 members", "3 members", "2 members", "a point", "a point")
    expected = [f"{ray}; landmark 0: {state}" for ray, state in zip(rays, states, strict=True)]
    assert [caption(WITH_RAYS, step, name) for step in steps] == expected
    none = np.zeros(0, np.int64)
    no_ray = replace(WITH_RAYS, rays=RayLog(none, none, none, none, np.zeros((0, 4)), np.zeros(STEPS + 1, np.int64)))
    assert [has_rays(each) for each in (NO_HISTORY, no_ray, WITH_RAYS)] == [False, False, True]


@pytest.mark.parametrize("fates", [("ray", "ray", "ray"), ("lost",), ("lost", "ray", "point"), ("ray",), ("point",)])
def test_every_strip_has_six_moments_in_order(fates: tuple[Fate, ...]):
    estimate = estimate_with_rays(fates)
    _, steps = ray_moments(estimate)
    assert steps == sorted(set(steps)) and (len(steps), steps[0]) == (6, 0)
    assert "ray" not in fates or steps[-1] == STEPS  # the strip continues to the last record


@pytest.mark.parametrize("truth", [None, TRUTH], ids=["blind", "with truth"])
def test_all_panels_show_the_same_map(tmp_path: Path, drawn: dict[str, Figure], truth: Truth | None):
    save_ray_strip(tmp_path, Results("a", truth, RECORDING, {"ekf": WITH_RAYS}), "ekf")
    panels = drawn["rays"].axes
    ((left, right, bottom, top),) = {(*panel.get_xlim(), *panel.get_ylim()) for panel in panels}
    places = np.concatenate([WITH_RAYS.poses[:131, :2], LANDMARKS])
    assert len(panels) == 6 and ((places > [left, bottom]) & (places < [right, top])).all()
    assert panels[4].get_title() == "t = 7.0 s\n2 rays; landmark 0: a point"
    assert [text.get_text() for text in panels[4].texts] == ["0"]
