"""Readable axes for large coordinates and times."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from slamgauge.compare.figures import animation_scene, ray_strip, run_figures
from slamgauge.compare.figures.animation_scene import Scene
from slamgauge.compare.figures.axes import label_plane, label_time, round_origin
from slamgauge.compare.figures.run_figures import plot_errors, plot_run, save_figure
from slamgauge.compare.storage.stored_results import Results
from slamgauge.ekf import FilterSettings, Rays, riekf
from tests.reference.random_recordings import random_recording

FAR = np.array([500_000.0, 4_600_000.0, 0.0])  # [m]: UTM coordinates of southern Europe
EPOCH = 1.7e9  # [s] since 1970
MINUS, THIN = "\N{MINUS SIGN}", "\N{NARROW NO-BREAK SPACE}"


def tick_labels(ax: Axes) -> tuple[list[str], list[str]]:
    """Return the tick labels of x and y as drawn."""
    assert isinstance(ax.figure, Figure)
    FigureCanvasAgg(ax.figure).draw()
    return [each.get_text() for each in ax.get_xticklabels()], [each.get_text() for each in ax.get_yticklabels()]


@pytest.mark.parametrize(
    ("x", "y", "labels"),
    [
        ((-15, 15), (-5, 25), ("x [m]", "y [m]")),
        ((9_000, 9_005), (0, 5), ("x [m]", "y [m]")),
        ((0, 80_000), (-40_000, 40_000), ("x [m]", "y [m]")),
        (
            (499_985, 500_015),
            (4.599995e6, 4.600025e6),
            (f"x {MINUS} 500{THIN}000 [m]", f"y {MINUS} 4{THIN}600{THIN}000 [m]"),
        ),
        ((-512_390, -512_340), (0, 50), (f"x + 512{THIN}400 [m]", "y [m]")),
        ((500_000.0, 500_000.4), (0, 0.4), (f"x {MINUS} 500{THIN}000 [m]", "y [m]")),
    ],
)
def test_labels_name_the_origin_of_the_ticks(
    x: tuple[float, float], y: tuple[float, float], labels: tuple[str, str]
) -> None:
    ax = Figure().subplots()
    ax.set(xlim=x, ylim=y)
    label_plane(ax)
    assert (ax.get_xlabel(), ax.get_ylabel()) == labels
    for texts, ticks, limits in zip(tick_labels(ax), (ax.get_xticks(), ax.get_yticks()), (x, y), strict=True):
        origin = round_origin(*limits, max(x[1] - x[0], y[1] - y[0]))
        assert len({*texts}) == len(texts) > 2
        values = np.array([float(text.replace(MINUS, "-")) for text in texts])
        assert values + origin == pytest.approx(ticks, abs=1e-6)


def test_an_axis_without_extent_has_origin_zero() -> None:
    assert round_origin(5e5, 5e5, 0.0) == 0.0


def test_large_times_have_an_origin_too() -> None:
    ax = Figure().subplots()
    ax.set_xlim(EPOCH, EPOCH + 60)
    assert label_time(ax) == f"time {MINUS} 1{THIN}700{THIN}000{THIN}000 [s]"
    assert "20" in tick_labels(ax)[0]
    ax.set_xlim(0, 60)
    assert label_time(ax) == "time [s]"


def test_all_figures_of_a_distant_run_have_short_tick_labels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = random_recording(1, steps=40)[1]
    recording = replace(recording, prior_mean=recording.prior_mean + FAR, stamps=recording.stamps + EPOCH)
    bearings = replace(
        recording,
        sensor="bearing",
        observation=recording.observation[:, 1:],
        observation_cov=recording.observation_cov[:, 1:, 1:],
    )
    maps: list[Axes] = []

    def labelled(ax: Axes, **which: bool) -> None:
        label_plane(ax, **which)
        maps.append(ax)

    for module in (animation_scene, ray_strip, run_figures):
        monkeypatch.setattr(module, "label_plane", labelled)
    estimates = {"riekf": riekf(bearings, FilterSettings(initialisation=Rays(), frames=20))}
    plot_run(Figure().subplots(), None, bearings, estimates)
    ray_strip.save_ray_strip(tmp_path, None, bearings, "riekf", estimates["riekf"], "a title")
    Scene(Results("a title", None, bearings, estimates), estimates, estimates)
    assert len(maps) > 3
    for ax in maps:
        assert {ax.get_xlabel()[:3], ax.get_ylabel()[:3]} <= {"", f"x {MINUS}", f"y {MINUS}"}
    assert f"4{THIN}600{THIN}" in maps[0].get_ylabel()
    panels: list[Axes] = list(Figure().subplots(3))
    plot_errors(panels, None, bearings, estimates)
    assert panels[-1].get_xlabel().startswith(f"time {MINUS} 1{THIN}700{THIN}")
    for ax in (*maps, *panels):
        for axis in (ax.xaxis, ax.yaxis):
            texts = axis.get_major_formatter().format_ticks(list(axis.get_ticklocs()))
            assert all(len(text) < 7 and "e" not in text for text in texts)
            assert axis.get_offset_text().get_text() == ""


def test_an_optimum_in_doubt_is_named_in_the_figure(tmp_path: Path) -> None:
    _, recording = random_recording(1, steps=10)
    optimum = replace(riekf(recording), nis=None, nis_dof=None, optimum_check=0.31)
    texts = {}
    for name, each in (("sure", replace(optimum, optimum_check=0.01)), ("doubtful", optimum)):
        (tmp_path / name).mkdir()
        save_figure(tmp_path / name, None, recording, {"causal": each}, "a title")
        texts[name] = (tmp_path / name / "figure.svg").read_text(encoding="utf-8")
    remark = "causal is 0.31 sigma from the optimum at a checked step"
    assert [remark in texts[name] for name in ("sure", "doubtful")] == [False, True]
    assert ["difference to causal? and" in texts[name] for name in ("sure", "doubtful")] == [False, True]
