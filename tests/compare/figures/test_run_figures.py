"""Map and errors of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from slamgauge.arrays import Float
from slamgauge.compare.figures.plot_style import STYLES, USER_STYLES
from slamgauge.compare.figures.run_figures import plot_errors, plot_run, save_figure
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation
from slamgauge.truth import Truth

Estimates = Mapping[str, Estimate]
STEPS = 200
LANDMARKS = np.array([[0.0, -2.0], [4.0, 3.0], [0.0, 10.0]])
ODOMETRY, IDS = np.tile([0.2, 0.0, 0.04], (STEPS, 1)), np.array([0, 1, 2, 0, 0])
POSES = chain(np.zeros(3), ODOMETRY)
TRUTH = Truth(POSES, np.arange(3), LANDMARKS, IDS)
RECORDING = Recording(  # a circle of 40 s; landmark 0 is observed at the start and re-observed from 32 s
    stamps=np.linspace(0, 40, STEPS + 1),
    prior_mean=np.zeros(3),
    prior_cov=np.zeros((3, 3)),
    odometry=ODOMETRY + np.array([0.0, 0.0, 1e-3]),
    odometry_cov=np.tile(1e-4 * np.eye(3), (STEPS, 1, 1)),
    sensor="range-bearing",
    observation_step=np.array([0, 50, 80, 160, 161]),
    observation=np.tile([1.0, 0.0], (5, 1)),
    observation_cov=np.tile(0.01 * np.eye(2), (5, 1, 1)),
    landmark=IDS,
)
DRIFTING = Estimate("filtered", chain(RECORDING.prior_mean, RECORDING.odometry))


def estimate(offset: Sequence[float] = (0.0, 0.0, 0.0), **fields: Any) -> Estimate:
    given: dict[str, Any] = {
        "kind": "filtered",
        "poses": POSES + np.asarray(offset),
        "pose_covs": np.tile(np.diag([0.04, 0.01, 0.0004]), (STEPS + 1, 1, 1)),
        "landmark_ids": np.arange(3),
        "landmarks": LANDMARKS + 0.1,
        "landmark_covs": np.tile(0.01 * np.eye(2), (3, 1, 1)),
    }
    return Estimate(**(given | fields))


def labels(ax: Axes) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def ellipses(ax: Axes) -> list[EllipseCollection]:
    return [each for each in ax.collections if isinstance(each, EllipseCollection)]


def curve(ax: Axes, label: str) -> Float:
    return next(np.asarray(line.get_xydata()) for line in ax.lines if line.get_label() == label)


def map_of(estimates: Estimates, truth: Truth | None = TRUTH, recording: Recording = RECORDING) -> Axes:
    ax = Figure().subplots()
    plot_run(ax, truth, recording, estimates)
    return ax


def panels_of(estimates: Estimates, truth: Truth | None = TRUTH, recording: Recording = RECORDING) -> list[Axes]:
    axes = list(Figure().subplots(3))
    plot_errors(axes, truth, recording, estimates)
    return axes


def test_styles_are_all_distinct():
    everyone = [*STYLES.values(), *USER_STYLES]
    for part in zip(*everyone, strict=True):
        assert len({*part}) == len(everyone)


def test_the_map_shows_paths_landmarks_and_marks():
    ax = map_of({"ekf": estimate([0.1, 0, 0])})
    paths, marks = ["truth", "dead-reckoning", "ekf"], ["true landmark", "loop closures", "start"]
    assert labels(ax) == [*paths, *marks, "mapped landmark", "3σ ellipse"]
    assert np.array_equal(curve(ax, "truth"), POSES[:, :2])
    assert np.array_equal(curve(ax, "loop closures"), POSES[160:161, :2])
    assert curve(ax, "dead-reckoning") == pytest.approx(DRIFTING.poses[:, :2])
    assert (ax.get_aspect(), ax.get_xlabel(), ax.get_ylabel()) == (1, "x [m]", "y [m]")


def test_ellipses_have_three_sigma_axes_along_the_covariance():
    turn = rotation(0.5)
    covs = np.tile(turn @ np.diag([4.0, 1.0]) @ turn.T, (3, 1, 1))
    (collection,) = ellipses(map_of({"ekf": estimate(pose_covs=None, landmark_covs=covs)}))
    assert collection.get_widths() == pytest.approx([12, 12, 12])
    assert collection.get_heights() == pytest.approx([6, 6, 6])
    assert np.asarray(collection.get_angles()) % 180 == pytest.approx(np.degrees([0.5, 0.5, 0.5]))
    assert np.asarray(collection.get_offsets()) == pytest.approx(LANDMARKS + 0.1)
    for count, drawn in ((10, 2), (100, 1)):  # crowded maps have ellipses of the first estimate only
        covs, places = np.tile(np.eye(2), (count, 1, 1)), np.zeros((count, 2))
        many = estimate(pose_covs=None, landmark_ids=np.arange(count), landmarks=places, landmark_covs=covs)
        assert len(ellipses(map_of({"ekf": many, "riekf": many}))) == drawn


def test_limits_of_the_map_ignore_drifted_dead_reckoning_unless_it_is_alone():
    drifted = Estimate("filtered", 100 * DRIFTING.poses)
    ax = map_of({"dead-reckoning": drifted, "ekf": estimate()})
    assert ax.get_xlim()[1] - ax.get_xlim()[0] < 30
    assert ax.get_title() == "dead reckoning exceeds the axes"
    alone = map_of({}, truth=None)
    assert (labels(alone), alone.get_title()) == (["dead-reckoning", "loop closures", "start", "mapped landmark"], "")


def test_errors_are_drawn_in_metres_and_degrees_with_the_first_band_filled():
    panels = panels_of({"riekf": estimate([0.1, -0.2, np.radians(2)]), "ekf": estimate(), "causal": estimate()})
    for panel, error, bound in zip(panels, [0.1, -0.2, 2.0], [0.6, 0.3, np.degrees(0.06)], strict=True):
        assert curve(panel, "riekf")[:, 0] == pytest.approx(RECORDING.stamps)
        assert curve(panel, "riekf")[:, 1] == pytest.approx(np.full(STEPS + 1, error))
        ends = [np.asarray(line.get_ydata())[-1] for line in panel.lines]
        assert [min(ends), max(ends)] == pytest.approx([-bound, bound])
        assert -panel.get_ylim()[0] == panel.get_ylim()[1] >= bound
        assert len(panel.lines) == 3 * 3 + 1  # error and two bounds each, zero
    assert [panel.get_ylabel() for panel in panels] == ["x [m]", "y [m]", "heading [°]"]
    assert (panels[0].get_title(), panels[2].get_xlabel()) == ("error and ±3σ", "time [s]; ticks: loop closures")
    (filled,) = (each for each in panels[0].collections if not isinstance(each, LineCollection))
    assert to_hex(np.asarray(filled.get_facecolor())[0]) == STYLES["riekf"].color.lower()


def test_errors_leave_out_dead_reckoning_and_ignore_a_diverged_estimate_and_name_both():
    assert labels(panels_of({"dead-reckoning": DRIFTING})[0]) == ["dead-reckoning"]
    both = panels_of({"dead-reckoning": DRIFTING, "ekf": estimate()})[0]
    assert (labels(both), both.get_title()) == (["ekf"], "error and ±3σ (dead reckoning not drawn)")
    near, lost = estimate([0.01, 0.0, 0.0]), estimate([40.0, 0.0, 0.0])
    panel = panels_of({"near": near, "lost": lost, "too": near})[0]
    assert panel.get_title() == "error and ±3σ (lost exceeds the axes)"
    assert panel.get_ylim() == pytest.approx((-0.66, 0.66))  # 3 sigma are 0.6 m


def test_without_truth_differences_to_the_optimum_or_only_bounds_are_drawn():
    for best, shown, error, title in (
        ("batch", ["ekf", "causal"], 0.2, "difference to batch and ±3σ"),
        ("causal", ["ekf"], 0.2, "difference to causal and ±3σ"),
        ("riekf", ["ekf", "riekf"], np.nan, "±3σ only: no truth, no optimum"),
    ):
        estimates = {name: estimate([0.3, 0, 0]) for name in shown} | {best: estimate([0.1, 0, 0])}
        panel = panels_of(estimates, truth=None)[0]
        assert (labels(panel), panel.get_title()) == (shown, title)
        assert curve(panel, "ekf")[:, 1] == pytest.approx(np.full(STEPS + 1, error), nan_ok=True)


def test_an_optimum_in_doubt_is_named_and_marked(tmp_path: Path, drawn: dict[str, Figure]):
    for check, is_marked in ((0.01, False), (0.31, True)):
        estimates = {"causal": estimate(optimum_check=check), "ekf": estimate([0.1, 0, 0])}
        save_figure(tmp_path, None, RECORDING, estimates, "a title")
        title, panel = drawn["figure"].get_suptitle(), drawn["figure"].axes[1].get_title()
        assert ("causal is 0.31 sigma from the optimum at a checked step" in title) == is_marked
        assert ("difference to causal? and" in panel) == is_marked


@pytest.mark.slow
def test_files_of_the_figure_are_reproducible_and_names_with_dollars_are_not_formulas(tmp_path: Path):
    estimates = {"ekf": estimate([0.1, 0, 0]), r"$\frac$": estimate([0, 0.1, 0])}
    written: list[list[bytes]] = []
    for _ in range(2):
        save_figure(tmp_path, TRUTH, RECORDING, estimates, r"cost $\frac$ of $")
        written.append([(tmp_path / f"figure.{form}").read_bytes() for form in ("png", "svg")])
    assert written[0] == written[1]
    picture, text = written[0]
    assert (int.from_bytes(picture[16:20], "big"), int.from_bytes(picture[20:24], "big")) == (1400, 920)  # 7.0 x 4.6 in
    assert ElementTree.fromstring(text).attrib["width"] == "504pt"
    assert b">cost $\\frac$ of $</text>" in text


def test_only_some_of_many_loop_closures_are_marked():
    """Steps of 10 s and one landmark that is observed at every second step."""
    steps, stamps = np.arange(0, STEPS, 2), np.linspace(0.0, 10.0 * STEPS, STEPS + 1)
    recording = replace(RECORDING.only(np.zeros_like(steps)), stamps=stamps, observation_step=steps)
    panels = panels_of({"ekf": estimate()}, recording=recording)
    ticks = [each for each in panels[0].collections if isinstance(each, LineCollection)]
    assert [len(each.get_segments()) for each in ticks] == [50]  # every second one of 99
    assert panels[2].get_xlabel() == "time [s]; ticks: 1 in 2 loop closures"
    assert "1 in 2 loop closures" in labels(map_of({}, recording=recording))
