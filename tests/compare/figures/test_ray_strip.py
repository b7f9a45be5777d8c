"""The strip of rays: its moments, its contents, and its files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slamgauge.compare.figures.map_contents import map_at
from slamgauge.compare.figures.map_layers import FAINTEST, MapLayer
from slamgauge.compare.figures.publishing import draw_comparison
from slamgauge.compare.figures.ray_frames import has_rays, ray_frames
from slamgauge.compare.figures.ray_strip import save_ray_strip
from slamgauge.compare.scoring.comparison import Comparison, write_comparison
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.estimate import Estimate, MapHistory, RayLog
from tests.reference.example_rays import AGES, BIRTHS, LANDMARKS, NOTED, STEPS, Fate, estimate_with_rays, half_loop

from .conftest import Written

pytestmark = pytest.mark.slow

LOST: tuple[Fate, ...] = ("lost",)
STILL: tuple[Fate, ...] = ("ray", "ray", "ray")


def history_of(estimate: Estimate) -> MapHistory:
    assert estimate.history is not None
    return estimate.history


def log_of(estimate: Estimate) -> RayLog:
    assert estimate.rays is not None
    return estimate.rays


# --- the map at a step -------------------------------------------------------------------------


def test_the_map_is_the_last_recorded_one():
    estimate = estimate_with_rays()
    history = history_of(estimate)
    gap = int(np.setdiff1d(np.arange(STEPS), NOTED)[-1])
    for step, noted in ((0, 0), (int(NOTED[7]), int(NOTED[7])), (gap, gap - 1), (STEPS, STEPS)):
        rows = map_at(estimate, step)
        np.testing.assert_array_equal(rows.position, history.position[history.step == noted])
        np.testing.assert_array_equal(rows.member, history.member[history.step == noted])


def test_the_map_is_empty_before_the_first_record():
    history = history_of(estimate_with_rays())
    late = history.step >= 10
    later = MapHistory(*(getattr(history, name)[late] for name in MapHistory.__dataclass_fields__))
    assert len(map_at(replace(estimate_with_rays(), history=later), 9).weight) == 0


def test_a_ray_lost_since_the_last_record_is_not_in_the_map():
    estimate = estimate_with_rays(LOST)
    end = BIRTHS[0] + AGES[-1]
    assert len(map_at(estimate, end - 1).weight) == 2
    assert len(map_at(estimate, end).weight) == 0


def test_a_new_ray_of_a_lost_landmark_is_in_the_map():
    again = [0, BIRTHS[0] + AGES[-1]]
    log = RayLog(
        *(np.array(column) for column in ([0, 0], again, [again[1], -1], [-1, -1])),
        distances=np.full((2, 4), np.nan),
        members=np.zeros(STEPS + 1, np.int64),
    )
    estimate = replace(estimate_with_rays(("ray",)), rays=log)
    assert again[1] in NOTED
    assert len(map_at(estimate, again[1]).weight) == 2


def test_the_most_likely_member_of_each_ray():
    estimate = estimate_with_rays()
    assert not map_at(estimate, 0).heaviest().any()  # all four have the same weight
    rows = map_at(estimate, 12)
    heaviest = rows.only(rows.heaviest())
    assert heaviest.landmark.tolist() == [0, 1]
    for landmark, weight in zip(heaviest.landmark, heaviest.weight, strict=True):
        assert weight == rows.weight[rows.landmark == landmark].max()
    assert not map_at(estimate, STEPS).heaviest().any()  # points


def test_opacity_of_members_grows_with_their_weight():
    rows = map_at(estimate_with_rays(), 12)
    ax = Figure().subplots()
    layer = MapLayer(ax, "#CC3311")
    layer.show(rows)
    points, members = ax.collections
    assert len(np.asarray(points.get_offsets())) == 0
    np.testing.assert_array_equal(members.get_offsets(), rows.position)
    opacity = np.asarray(members.get_edgecolor())[:, 3]
    assert opacity == pytest.approx(FAINTEST + (1 - FAINTEST) * rows.weight)
    layer.show(map_at(estimate_with_rays(), STEPS))
    assert [len(np.asarray(each.get_offsets())) for each in (points, members)] == [3, 0]


# --- the moments -------------------------------------------------------------------------------


def test_the_strip_shows_all_main_events():
    events = [(frame.step, frame.caption, frame.landmark, frame.rays, frame.members) for frame in frames()]
    assert events == [
        (0, "landmark 0 begins", 0, 1, 4),
        (5, "landmark 1 begins", 1, 2, 8),
        (12, "landmark 0: 3 of 4 members remain", 0, 2, 7),
        (30, "landmark 0: 2 of 3 members remain", 0, 2, 5),
        (70, "landmark 0: member 3 of 4 remains", 0, 2, 6),
        (130, "landmark 2: member 4 of 4 remains", 2, 0, 0),
    ]


def frames(fates: tuple[Fate, ...] = ("point", "point", "point"), count: int = 6):
    return ray_frames(estimate_with_rays(fates), count)


def test_events_between_records_are_shown_at_the_next_record():
    estimate = estimate_with_rays(("point",))
    missing = next(step for step in range(AGES[-1], STEPS) if step not in NOTED)
    later = replace(estimate, rays=replace(log_of(estimate), end=np.array([missing])))
    assert [frame.step for frame in ray_frames(later, 4) if "remains" in frame.caption] == [missing + 1]


@pytest.mark.parametrize("fates", [STILL, LOST, ("lost", "ray", "point"), ("ray",), ("point",)])
@pytest.mark.parametrize("count", [1, 2, 6, 9])
def test_the_requested_number_of_moments_in_order(fates: tuple[Fate, ...], count: int):
    steps = [frame.step for frame in frames(fates, count)]
    assert steps == sorted(set(steps))
    assert len(steps) == count
    assert steps[0] == 0


def test_a_lost_ray_has_a_caption():
    assert frames(LOST)[-1] == (BIRTHS[0] + AGES[-1], "landmark 0 is lost", 0, 0, 0)


def test_several_rays_at_once_are_counted():
    estimate = estimate_with_rays(STILL)
    together = replace(estimate, rays=replace(log_of(estimate), birth=np.zeros(3, np.int64)))
    first = ray_frames(together, 6)[0]
    assert (first.caption, first.landmark) == ("3 rays begin", None)


def test_few_records_give_few_moments():
    estimate = estimate_with_rays(STILL)
    history = history_of(estimate)
    kept = np.isin(history.step, [0, STEPS])
    short = MapHistory(*(getattr(history, name)[kept] for name in MapHistory.__dataclass_fields__))
    assert [frame.step for frame in ray_frames(replace(estimate, history=short), 6)] == [0, STEPS]


# --- the files ---------------------------------------------------------------------------------


@pytest.mark.parametrize("fates", [("point", "point", "point"), ("lost", "ray", "point"), ("ray",)])
def test_files_of_the_strip_are_reproducible(written_twice: Written, fates: tuple[Fate, ...]):
    truth, recording = half_loop()
    estimate = estimate_with_rays(fates)
    png, svg = written_twice(lambda out: save_ray_strip(out, truth, recording, "ekf", estimate, "a title"), "rays")
    assert int.from_bytes(png[16:20], "big") == 1400  # 7.0 in
    assert ElementTree.fromstring(svg).attrib["width"] == "504pt"
    assert b"<image" not in svg


@pytest.fixture
def panels_of(drawn: dict[str, Figure], tmp_path: Path) -> Callable[..., list[Axes]]:
    """A function that draws the strip of an estimate and returns its panels."""

    def panels(estimate: Estimate, *, blind: bool = False) -> list[Axes]:
        truth, recording = half_loop()
        save_ray_strip(tmp_path, None if blind else truth, recording, "ekf", estimate, "a title")
        return drawn["rays"].axes

    return panels


def test_all_panels_have_the_same_limits_and_equal_scales(panels_of: Callable[..., list[Axes]]):
    panels = panels_of(estimate_with_rays())
    assert len(panels) == 6
    assert len({(*panel.get_xlim(), *panel.get_ylim()) for panel in panels}) == 1
    assert {panel.get_aspect() for panel in panels} == {1}
    (left, right), (bottom, top) = panels[0].get_xlim(), panels[0].get_ylim()
    low, high = LANDMARKS.min(axis=0), LANDMARKS.max(axis=0)
    assert left < low[0] < high[0] < right
    assert bottom < low[1] < high[1] < top
    assert panels[4].get_title() == "t = 7.0 s, 2 rays, 6 members\nlandmark 0: member 3 of 4 remains"


def test_collapsed_rays_are_marked_in_the_next_panel(panels_of: Callable[..., list[Axes]]):
    panels = panels_of(estimate_with_rays())
    marked = [
        sum(len(np.asarray(line.get_xdata())) for line in panel.lines if line.get_marker() == "s") for panel in panels
    ]
    assert marked == [0, 0, 0, 0, 1, 2]


def test_a_strip_without_truth_contains_every_member(panels_of: Callable[..., list[Axes]]):
    (panel, *_) = panels_of(estimate_with_rays(("ray",)), blind=True)
    members = map_at(estimate_with_rays(("ray",)), 0).position
    assert (members[:, 0] < panel.get_xlim()[1]).all()
    assert (members[:, 1] < panel.get_ylim()[1]).all()


def test_a_comparison_draws_the_first_estimate_with_rays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    truth, recording = half_loop()
    with_rays = estimate_with_rays()
    without = replace(with_rays, rays=None, history=None)
    none = np.zeros(0, np.int64)
    no_ray = replace(with_rays, rays=RayLog(none, none, none, none, np.zeros((0, 4)), np.zeros(STEPS + 1, np.int64)))
    assert [has_rays(each) for each in (without, no_ray, with_rays)] == [False, False, True]
    drawn: list[str] = []

    def keep(*arguments: Any) -> None:
        drawn.append(arguments[3])

    monkeypatch.setattr("slamgauge.compare.figures.publishing.save_ray_strip", keep)
    for i, estimates in enumerate(({"a": without, "b": no_ray}, {"a": without, "b": with_rays, "c": with_rays})):
        comparison, folder = Comparison(truth, recording, estimates, {}), tmp_path / str(i)
        begin_folder(folder)
        write_comparison(folder, comparison, {})
        assert draw_comparison(folder, comparison, "a title")
    assert drawn == ["b"]
